"""The experiments behind the documents: ``python -m experiments`` lists them.

Each module that ``__main__.NAMES`` lists has its help as docstring, ``add_arguments(parser)`` and
``run(args)``.
"""
