"""Synthetic depth frames: poses, surfaces, rendering and a sensor model."""
