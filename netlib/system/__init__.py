"""Interfaces to the operating system: memory limits."""
