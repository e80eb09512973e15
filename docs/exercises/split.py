# Write what raises NotImplementedError, then: python tools/exercise.py split
"""Split: hand one blob to several readers. The net inserts it by itself (netlib/splits.py).

bottom[0]  x    any shape
top[i]     y_i  same shape

y_i = x
dx  = sum of dy_i          what each reader wants of x, taken together
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


class Split(Layer):
    """Copy one blob to several."""

    bottoms = (1, 1)
    tops = (1, None)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        # Give every top the shape of bottom[0].
        raise NotImplementedError

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        # Copy bottom[0].data into every top.
        raise NotImplementedError

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        # If propagate_down[0], write bottom[0].diff: the sum of the diffs of all tops. It holds old numbers, so the
        # first of them is written and not added.
        raise NotImplementedError
