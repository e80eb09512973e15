"""Experiments: many nets trained with one recipe, and their scores."""
