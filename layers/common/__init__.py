"""Layers of every net: products, copies, shapes."""
