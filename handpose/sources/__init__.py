"""Depth recordings, read and written frame by frame: folders, stacks, videos, cameras' formats, a live camera."""
