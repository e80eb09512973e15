"""The colours of all figures of the book, by what they mean."""

from __future__ import annotations

VALUE, GRADIENT = "#117733", "#cc3311"  # numbers that go towards the loss, and those that come back
FORCE = GRADIENT
POSITIVE, NEGATIVE = "#cc3311", "#2166ac"  # of a weight; as maps use them: RdBu_r
SIGNS = "RdBu_r"  # the colour map of signed numbers
DEPTH = "gray_r"  # the colour map of depth: near is bright
FIRST, SECOND, THIRD, FOURTH = "#2166ac", "#ee7733", "#117733", "#882299"  # curves and parts, in this order
FAINT, LINE, INK = "#eeeeee", "#999999", "#222222"
AXES = ("#cc3311", "#117733", "#2166ac")  # x, y, z of a frame
FINGERS = {"thumb": "#cc3311", "index": "#dd7700", "middle": "#117733", "ring": "#2166ac", "little": "#882299"}
PALM = "#555555"
