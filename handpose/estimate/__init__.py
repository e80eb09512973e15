"""Estimate hands in depth images: locate them, crop them, run a network, and fit a capsule
model to the depth.
"""
