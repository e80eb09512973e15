"""LRN: divide each value by a power of the mean square of its neighbours ("local response normalization").

bottom[0]  x  (N, C, H, W)
top[0]     y  same shape

    s  = k + alpha * mean of x² over the n neighbours        y = x s^-beta

    dx = dy s^-beta - 2 alpha beta x * mean over the n neighbours of (dy x s^(-beta - 1))

The neighbourhood is centred on the value: ``local_size`` channels at the same position (ACROSS_CHANNELS), or a square
of ``local_size`` x ``local_size`` positions in the same channel (WITHIN_CHANNEL, where k is always 1). Neighbours
beyond the edge count as zeros, so n is constant. Kept for backward: ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from netlib.blob import Array, Blobs
from netlib.layer import Layer, warn_of_ignored
from netlib.proto.schema import Engine, UInt, numbered


@dataclass(frozen=True)
class LRNParameter:
    """The ``lrn_param { ... }`` block."""

    local_size: UInt = numbered(1, 5)  # neighbours along an axis, odd
    alpha: float = numbered(2, 1.0)
    beta: float = numbered(3, 0.75)
    norm_region: Literal["ACROSS_CHANNELS", "WITHIN_CHANNEL"] = numbered(4, "ACROSS_CHANNELS")
    k: float = numbered(5, 1.0)  # for ACROSS_CHANNELS only
    engine: Engine = numbered(6, "DEFAULT")  # accepted, ignored


class LRN(Layer):
    """Local response normalization."""

    param_type = LRNParameter
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.local_size % 2 == 0:
            raise self.fail(f"local_size {p.local_size} is even; expected an odd number",
                            "local_size")
        across = p.norm_region == "ACROSS_CHANNELS"
        self.axes = (1,) if across else (2, 3)
        self.k = p.k if across else 1.0
        if not across:
            warn_of_ignored(self, "k", advice=" with WITHIN_CHANNEL")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom[0].shape) != 4:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, expected (N, C, H, W)")
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        self.s = self.k + self.param.alpha * self._mean(x * x)
        top[0].data[...] = x * self.s**-self.param.beta

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            x, dy, s, p = bottom[0].data, top[0].diff, self.s, self.param
            from_neighbours = 2 * p.alpha * p.beta * x * self._mean(dy * x * s ** (-p.beta - 1))
            bottom[0].diff[...] = dy * s**-p.beta - from_neighbours

    def _mean(self, values: Array) -> Array:
        """Mean over the neighbourhood of each value."""
        size = self.param.local_size
        for axis in self.axes:
            side = min(size // 2, max(values.shape[axis] - 1, 0))  # beyond the edge there are only zeros
            padding = [(side, side) if i == axis else (0, 0) for i in range(4)]
            values = sliding_window_view(np.pad(values, padding), 2 * side + 1, axis).sum(axis=-1) / size
        return values
