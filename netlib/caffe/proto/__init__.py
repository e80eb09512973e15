"""Caffe's messages as classes of the package protobuf."""
