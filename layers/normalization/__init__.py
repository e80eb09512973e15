"""Layers that normalize values."""
