"""LRN: divide each value by a power of the mean square of its neighbours ("local response
normalization").

bottom[0]  x  (N, C, H, W)
top[0]     y  same shape

    s  = k + alpha * mean of x² over the n neighbours        y = x s^-beta

    dx = dy s^-beta - 2 alpha beta x * mean over the n neighbours of (dy x s^(-beta - 1))

The neighbourhood is centred on the value: ``local_size`` channels at the same position
(ACROSS_CHANNELS), or a square of ``local_size`` x ``local_size`` positions in the same channel
(WITHIN_CHANNEL, where k is always 1). Neighbours beyond the edge count as zeros, so n is constant.
Kept for backward: ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.common.images import check_images
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

    param: LRNParameter
    bottoms = tops = (1, 1)
    in_place = False
    batchwise = True
    reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.local_size % 2 == 0:
            raise self.fail(
                f"local_size {p.local_size} is even; expected an odd number", "local_size"
            )
        across = p.norm_region == "ACROSS_CHANNELS"
        self.axes = (0,) if across else (1, 2)
        self.k = p.k if across else 1.0
        if not across:
            warn_of_ignored(self, "k", advice=" with WITHIN_CHANNEL")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        check_images(self, bottom)
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.s = np.empty_like(bottom[0].data)
        for x, y, s in zip(bottom[0].data, top[0].data, self.s):
            s[...] = self.k + self.param.alpha * self._mean(x * x)
            np.divide(x, self._power(s), out=y)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            factor = 2 * self.param.alpha * self.param.beta
            for x, dy, s, dx in zip(bottom[0].data, top[0].diff, self.s, bottom[0].diff):
                scaled = dy / self._power(s)
                np.subtract(scaled, factor * x * self._mean(scaled * x / s), out=dx)

    def _power(self, s: Array) -> Array:
        """s^beta."""
        if self.param.beta == 0.75:  # two square roots take a fifth of the time of a power
            root = np.sqrt(s)
            return root * np.sqrt(root)
        return s**self.param.beta

    def _mean(self, values: Array) -> Array:
        """Mean over the neighbourhood of each value of an image (C, H, W), axis by axis."""
        radius = self.param.local_size // 2
        for axis in self.axes:
            shares = np.moveaxis(values / self.param.local_size, axis, 0)
            mean = shares.copy()
            for i in range(1, min(radius + 1, len(shares))):
                mean[i:] += shares[:-i]
                mean[:-i] += shares[i:]
            values = np.moveaxis(mean, 0, axis)
        return values
