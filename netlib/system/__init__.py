"""Interfaces to the operating system and to Python: memory limits, thread safety, module aliases."""
