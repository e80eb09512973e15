"""The colours of the book: the same meaning has the same colour in every figure and on every page."""

from __future__ import annotations

DATA = "#08519c"  # values: blobs' data, the forward pass, the first of two curves
DIFF = "#d95f02"  # gradients: blobs' diffs, the backward pass, the second of two curves
PALE_DATA = "#dbe9f6"
PALE_DIFF = "#fde3cf"
REST = "#636363"  # what takes no part
PALE_REST = "#eeeeee"
POSITIVE, NEGATIVE = "#b2182b", "#2166ac"  # the ends of matplotlib's RdBu_r, for signed values
