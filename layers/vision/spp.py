"""SPP: pool a map of any size to a fixed number of values ("spatial pyramid pooling").

bottom[0]  x  (N, C, H, W)
top[0]     y  (N, C + 4 C + 16 C + ...)   one term per level; (N, C, 1, 1) for a single level

Level l tiles the map with 2^l x 2^l windows, and takes over each

MAX   y = max of x over the window             dx[the first of the equal winners] += dy
AVE   y = sum of x over the window / area      dx[all of the window] += dy / area

The levels, each (N, C, 2^l, 2^l) flattened to (N, C 4^l), are concatenated.

Caffe's rules: a window has k = ceil(H / 2^l) rows, and columns likewise. If together they have more
rows than the map, the first starts half the excess, rounded up, above it; this must be less than k.
The area of AVE is the full window.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.vision.windows import SlidingWindow
from netlib.blob import Array, Blobs
from netlib.proto.schema import Engine, UInt, numbered

# part of x or dx in a window (N, C, h, w), its y or dy (N, C), its area
Bin = tuple[Array, Array, int]


@dataclass(frozen=True)
class SPPParameter:
    """The ``spp_param { ... }`` block."""

    pyramid_height: UInt = numbered(1, 0)  # number of levels
    pool: Literal["MAX", "AVE", "STOCHASTIC"] = numbered(2, "MAX")
    engine: Engine = numbered(6, "DEFAULT")  # accepted, ignored


class SPP(SlidingWindow):
    """Spatial pyramid pooling."""

    param: SPPParameter
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.pyramid_height == 0:
            raise self.fail("pyramid_height must be at least 1", "pyramid_height")
        if self.param.pool == "STOCHASTIC":
            raise self.fail(
                "STOCHASTIC pooling is not supported, as in Caffe on a CPU; expected MAX or AVE",
                "pool",
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self._check_map(bottom[0])
        N, C, H, W = bottom[0].shape
        levels = range(self.param.pyramid_height)
        self.windows = [
            (self._windows(H, 2**level), self._windows(W, 2**level)) for level in levels
        ]
        windows = sum(4**level for level in levels)
        top[0].reshape((N, C, 1, 1) if len(levels) == 1 else (N, C * windows))

    def _windows(self, size: int, bins: int) -> list[tuple[int, slice]]:
        """Along one axis: the length of every window, and the part of it on the map."""
        k = -(-size // bins)
        pad = (k * bins - size + 1) // 2
        if pad >= k:
            name = self.spec.bottom[0]
            raise self.fail(
                f"bottom {name!r} is too small for a level of {bins} x {bins} windows: "
                f"{size} in {bins} parts of {k} need a padding of {pad}",
                "pyramid_height",
            )
        begins = [i * k - pad for i in range(bins)]
        return [(k, slice(max(begin, 0), min(begin + k, size))) for begin in begins]

    def _bins(self, x: Array, y: Array) -> Iterator[Bin]:
        """Iterate over the windows of all levels."""
        N, C = x.shape[:2]
        begin = 0
        for rows, columns in self.windows:
            end = begin + C * len(rows) * len(columns)
            level = y.reshape(N, -1)[:, begin:end].reshape(N, C, len(rows), len(columns))
            for i, j in np.ndindex(level.shape[2:]):
                (kh, down), (kw, across) = rows[i], columns[j]
                yield x[:, :, down, across], level[:, :, i, j], kh * kw
            begin = end

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for window, y, area in self._bins(bottom[0].data, top[0].data):
            if self.param.pool == "MAX":
                y[...] = window.max(axis=(2, 3))
            else:
                y[...] = window.sum(axis=(2, 3)) / area

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        bottom[0].diff[...] = 0
        values = self._bins(bottom[0].data, top[0].data)
        gradients = self._bins(bottom[0].diff, top[0].diff)
        for (x, _, area), (dx, dy, _) in zip(values, gradients):
            if self.param.pool == "MAX":
                flat = x.reshape(*x.shape[:2], -1)
                is_first = flat.argmax(axis=2)[:, :, None] == np.arange(flat.shape[2])
                dx += dy[:, :, None, None] * is_first.reshape(x.shape)
            else:
                dx += dy[:, :, None, None] / area
