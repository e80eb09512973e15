"""Export of nets to other formats."""
