"""Silence: read unused blobs, so that they are not outputs of the net.

bottom[i]  x_i  any shape

dx_i = 0
"""

from __future__ import annotations

from netlib.blob import Blobs
from netlib.layer import Layer


class ZeroGradient(Layer):
    """Base class of layers whose gradient is 0, or 0 but for what a subclass adds."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for x, down in zip(bottom, propagate_down):
            if down:
                x.diff[...] = 0


class Silence(ZeroGradient):
    """Reads blobs and does nothing."""

    bottoms = (1, None)
    tops = (0, 0)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        pass

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        pass
