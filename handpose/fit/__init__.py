"""Fit a body to what was seen: to a depth image (depth_fit.py), or to joints (joints/)."""
