"""Depth recordings: folders, stacks, videos, cameras' own files, a live camera; read and written frame by frame."""
