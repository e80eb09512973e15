"""Shared by several tests: cases, recordings, programs, plain computations to compare with."""
