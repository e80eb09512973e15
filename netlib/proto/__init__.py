"""Caffe's messages: prototxt and binary formats, schema, message types, upgrade of old nets."""
