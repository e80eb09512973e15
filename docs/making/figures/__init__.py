"""The figures of the book, drawn from what the code computes: ``python -m docs.making.figures``."""
