"""Exercises: the reader rewrites parts of this project, checked step by step. tools/exercise.py is the command.

exercise.py defines what an exercise is. Each of relu.py ... resume.py is one exercise: the part to write, the data that
it is checked with, the known mistakes and the advice for each. table.py lists them. Layer exercises share layers.py,
layer_checks.py (the steps) and layer_examples.py (running a layer on an example). stubs.py generates the reader's file
from the project's source and reading.py loads it; checking.py runs the steps, explaining.py finds the likely mistake,
and network.py trains the paper's network with the reader's part.
"""
