"""Exercises: the reader rewrites parts of this project, checked step by step. tools/exercise.py
is the command.

exercise.py defines what an exercise is. Each of relu.py ... resume.py is one exercise: the part to
write, the data that it is checked with, and five known mistakes. table.py lists them. layers.py has
what layer exercises share. stubs.py generates the reader's file from the project's source; check.py
checks it, in a process that solutions.py starts; explaining.py finds the likely mistake; network.py
trains the paper's network with the reader's part.
"""
