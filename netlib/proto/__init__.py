"""Caffe's messages: text and binary formats, schema, message types, upgrade of old nets."""
