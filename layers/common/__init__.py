"""Layers of general use: products, copies, shapes."""
