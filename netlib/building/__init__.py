"""Building a layer from its text: finding its class, reading its options, importing
Python layers.
"""
