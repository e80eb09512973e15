# Replace each NotImplementedError, then run: python tools/exercise.py split
"""Split: copy a blob for several readers. The net inserts this layer automatically (netlib/splits.py).

bottom[0]  x    any shape
top[i]     y_i  same shape

y_i = x
dx  = sum of dy_i          the gradients of all readers add up
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


class Split(Layer):
    """Copies a blob for several readers."""

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
        # If propagate_down[0], write bottom[0].diff: the sum of the diffs of all tops. It contains old values, so
        # assign the first and add the others.
        raise NotImplementedError
