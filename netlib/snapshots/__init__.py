"""Weights and solver states: Caffe's two file formats, and copying weights between nets."""
