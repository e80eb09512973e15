"""Experiments: many nets trained with one recipe, and what they reach."""
