"""What netlib asks of the operating system and of Python: memory, one thread at a time, other names of modules."""
