"""Nets, solvers and skeletons, as data."""
