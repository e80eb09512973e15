"""Layers of single-shot detectors, from the SSD branch of Caffe."""
