"""Interfaces to the operating system and to Python: memory limits, module aliases."""
