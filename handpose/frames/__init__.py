"""Depth frames: cameras, images, crops, and recordings opened and written frame by frame."""
