"""Scores of predicted joints: errors in mm, success rates, published benchmarks."""
