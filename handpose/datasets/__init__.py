"""Data sets: NYU and ICVL as published, their files, and labelled frames in HDF5 lists."""
