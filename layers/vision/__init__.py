"""Layers that know rows and columns of an image."""
