"""The command-line tools: one file per command, and modules that several of them share. No command imports another.

All share arguments, console, progress, stopper and advice. Trainings share training and caffe_log, importers of data
sets preparing. Pictures and plots are in pictures and plots, what a net costs is in costs.
"""
