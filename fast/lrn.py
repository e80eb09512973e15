"""FastLRN: the sums over neighbours as running sums, and the power 3/4 by square roots."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.map_pooling import Windows, running, window_sums
from fast.parallel import scratch
from layers.normalization.lrn import LRN
from netlib.blob import Array, Blobs
from netlib.system.memory import blocks

BLOCK = 1 << 16  # values of the images of a block


class FastLRN(FastLayer, LRN):
    """Local response normalization, some images at a time."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = x s^-beta, and keep s for backward."""
        x, y, p = bottom[0].data, top[0].data, self.param
        if self.needs_backward:
            self.s = self.kept("s", x)

        def job(images: slice) -> None:
            own = x[images]
            square = np.multiply(own, own, out=scratch("square", own.shape, x.dtype))
            s = self._sums(square, self.s[images] if self.needs_backward else square)
            s *= x.dtype.type(p.alpha / p.local_size ** len(self.axes))
            s += x.dtype.type(self.k)
            np.divide(own, self._power(s), out=y[images])

        self._each(x, job)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx."""
        if not propagate_down[0]:
            return
        x, dy, dx, p = bottom[0].data, top[0].diff, bottom[0].diff, self.param
        factor = x.dtype.type(2 * p.alpha * p.beta / p.local_size ** len(self.axes))

        def job(images: slice) -> None:
            own, s = x[images], self.s[images]
            scaled = np.divide(dy[images], self._power(s), out=scratch("scaled", own.shape, x.dtype))
            product = np.multiply(scaled, own, out=scratch("square", own.shape, x.dtype))
            product /= s
            total = self._sums(product, product)
            total *= own
            total *= factor
            np.subtract(scaled, total, out=dx[images])

        self._each(x, job)

    @staticmethod
    def _each(x: Array, job: Callable[[slice], None]) -> None:
        size = max(1, BLOCK // max(x[:1].size, 1))
        parallel.run([partial(job, images) for images in blocks(len(x), size)])

    def _power(self, s: Array) -> Array:
        """s^beta, in working memory."""
        out = scratch("power", s.shape, s.dtype)
        if self.param.beta != 0.75:
            return np.power(s, s.dtype.type(self.param.beta), out=out)
        root = np.sqrt(s, out=out)
        fourth = np.sqrt(root, out=scratch("fourth root", s.shape, s.dtype))
        return np.multiply(root, fourth, out=out)

    def _sums(self, values: Array, out: Array) -> Array:
        """Write the sums over the neighbourhood of each value to ``out`` and return it."""
        size, (n, C, H, W) = self.param.local_size, values.shape
        if len(self.axes) == 2:
            (h, v) = (min(size // 2, max(length - 1, 0)) for length in (H, W))  # beyond the edge there are only zeros
            w = Windows((H, W), (H, W), (2 * h + 1, 2 * v + 1), (1, 1), (h, v))
            out.reshape(n * C, H, W)[...] = window_sums(w, values.reshape(n * C, H, W))
            return out
        side = min(size // 2, max(C - 1, 0))
        shape = (n, C + 2 * side, H * W)
        padded, total = scratch("padded channels", shape, values.dtype), scratch("channels", shape, values.dtype)
        padded[:, :side] = padded[:, side + C :] = 0
        padded[:, side : side + C] = values.reshape(n, C, H * W)
        running(np.add, padded.reshape(-1, H * W), 2 * side + 1, total.reshape(-1, H * W))
        out.reshape(n, C, H * W)[...] = total[:, :C]
        return out
