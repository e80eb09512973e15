"""Layers that read and write data."""
