"""Exercises: parts of this project that a reader writes again, checked step by step. tools/exercise.py is the command.

exercise.py says what an exercise is, and each of relu.py ... resume.py is one: what is to be written, with which
numbers it is checked, which mistakes are known and what is said of each. table.py lists them. Those of a layer share
layers.py, layer_checks.py (the steps) and layer_examples.py (a layer run on an example). stubs.py makes the reader's
file of our source, reading.py loads it again; checking.py runs the steps, explaining.py finds the likely mistake,
network.py trains the paper's network with the reader's part in it.
"""
