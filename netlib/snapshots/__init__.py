"""Weights and solver states: both of Caffe's file formats, and copying of weights from net to net."""
