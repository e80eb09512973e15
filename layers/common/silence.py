"""Silence: read unused blobs, so that they are not outputs of the net.

bottom[i]  x_i  any shape

dx_i = 0
"""

from __future__ import annotations

from netlib.blob import Blobs
from netlib.layer import ZeroGradient


class Silence(ZeroGradient):
    """Reads blobs and does nothing."""

    bottoms = (1, None)
    tops = (0, 0)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        pass

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        pass
