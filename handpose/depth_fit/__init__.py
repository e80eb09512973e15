"""The flesh of a body fitted to what a depth camera saw of it."""
