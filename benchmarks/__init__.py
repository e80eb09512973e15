"""Benchmarks and ablation studies."""
