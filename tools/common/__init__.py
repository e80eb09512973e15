"""Helpers shared by commands: arguments, output, progress, training, and importers of data sets."""
