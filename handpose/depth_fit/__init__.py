"""Fit the capsule model of a body to depth images."""
