"""The colours of the book: the same meaning has the same colour in every figure and on every page."""

from __future__ import annotations

DATA, DIFF = "#08519c", "#d95f02"  # values and the forward pass; gradients and the backward pass
PALE_DATA, PALE_DIFF = "#dbe9f6", "#fde3cf"
REST, PALE_REST = "#636363", "#eeeeee"  # everything else
FORCE = DIFF  # a force is a gradient
POSITIVE, NEGATIVE = "#b2182b", "#2166ac"  # the ends of SIGNS
SIGNS = "RdBu_r"  # the colour map of signed numbers
DEPTH = "gray_r"  # the colour map of depth: near is bright
FIRST, SECOND, THIRD, FOURTH = DATA, DIFF, "#117733", "#882299"  # curves and parts, in this order
LINE, INK = "#999999", "#222222"
AXES = ("#cc3311", "#117733", "#2166ac")  # x, y, z of a frame
FINGERS = {"thumb": "#cc3311", "index": "#dd7700", "middle": "#117733", "ring": "#2166ac", "little": "#882299"}
PALM = "#555555"
# The same colours on a dark page, of lines and letters, and of areas; docs/book/pages/common.css repeats some of them.
DARK = {
    "#000000": "#e7eaf0", INK: "#e7eaf0", DATA: "#7fb2f0", DIFF: "#f0954d", NEGATIVE: "#7fb2f0", THIRD: "#4fb06d",
    FOURTH: "#c583d8", REST: "#98a2b3", PALM: "#b4bac4", FINGERS["thumb"]: "#f0705a",
}
DARK_AREAS = {
    **DARK, "#ffffff": "#1c2027", PALE_DATA: "#20344d", PALE_DIFF: "#4a2f1c", PALE_REST: "#2a2f38",
    "#ededed": "#2a2f38",
}
