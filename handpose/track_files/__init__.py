"""Tracks of hands over time: the data, and files for other programs."""
