"""Depth frames, crops and labels: as data sets publish them, and as the HDF5 files that nets read."""
