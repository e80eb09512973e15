"""Depth frames, crops and labels: in files of data sets, and in the HDF5 files that nets read."""
