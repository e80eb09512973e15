"""Weights with their cards, in the way of Caffe's model zoo; a package so that they
are installed.
"""
