# Write what raises NotImplementedError, then: python tools/exercise.py pooling
"""Pooling: the maximum or the mean of a window that slides over each channel.

bottom[0]  x     (N, C, H, W)
top[0]     y     (N, C, Ho, Wo)   Ho = ceil((H + 2 pad - kernel) / stride) + 1, same for Wo
top[1]     mask  (N, C, Ho, Wo)   optional, of MAX: where in its map a maximum stands, h W + w; -1 if nowhere

MAX   y = max of x over the window             dx[winner] += dy
AVE   y = sum of x over the window / area      dx[each of the window] += dy / area

Caffe's rules: the output size is rounded **up** (unless ``round_mode: FLOOR``), so a last window may hang over the
edge, also the only one; with pad > 0, in either direction, a last window that starts beyond the image is dropped. MAX
takes the first of equal values and never a pad. The area of AVE counts padding, but not what hangs over it. A window
without any value (stride > kernel) gives -FLT_MAX or NaN. The mask gets no gradient.

Kept for backward: ``winners``, for each output of MAX the place in its window, row by row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto.schema import Engine, UInt, numbered

NOTHING = -float(np.finfo(np.float32).max)  # Caffe's maximum over no values


@dataclass(frozen=True)
class PoolingParameter:
    """The ``pooling_param { ... }`` block."""

    pool: Literal["MAX", "AVE", "STOCHASTIC"] = numbered(1, "MAX")
    kernel_size: UInt | None = numbered(2, None)
    kernel_h: UInt | None = numbered(5, None)
    kernel_w: UInt | None = numbered(6, None)
    pad: UInt = numbered(4, 0)
    pad_h: UInt | None = numbered(9, None)
    pad_w: UInt | None = numbered(10, None)
    stride: UInt = numbered(3, 1)
    stride_h: UInt | None = numbered(7, None)
    stride_w: UInt | None = numbered(8, None)
    global_pooling: bool = numbered(12, False)  # one window, the whole map
    round_mode: Literal["CEIL", "FLOOR"] = numbered(13, "CEIL")
    engine: Engine = numbered(11, "DEFAULT")  # Caffe's choice of implementation; accepted, ignored


class Pooling(Layer):
    """Spatial pooling."""

    param_type = PoolingParameter
    bottoms = (1, 1)
    tops = (1, 2)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.pool == "STOCHASTIC":
            raise self.fail("STOCHASTIC pooling: Caffe has none on a CPU; expected MAX or AVE", "pool")
        if len(top) > 1 and p.pool != "MAX":
            raise self.fail(f"has 2 tops, but only MAX pooling has a mask, not {p.pool}", "pool")
        block = self.spec.blocks.get("pooling_param")
        for both, each in (("kernel_size", "kernel"), ("pad", "pad"), ("stride", "stride")):
            if block and block.values(both) and (block.values(f"{each}_h") or block.values(f"{each}_w")):
                raise self.fail(f"give either {both}, or {each}_h and {each}_w", both)
            if block and bool(block.values(f"{each}_h")) != bool(block.values(f"{each}_w")):
                raise self.fail(f"needs {both}, or {each}_h and {each}_w", both)
        if p.global_pooling and (p.kernel_size or p.kernel_h or p.kernel_w):
            raise self.fail("global_pooling takes no kernel size", "global_pooling")
        self.pad = (_or(p.pad_h, p.pad), _or(p.pad_w, p.pad))
        self.stride = (_or(p.stride_h, p.stride), _or(p.stride_w, p.stride))
        self.kernel = (_or(p.kernel_h, p.kernel_size or 0), _or(p.kernel_w, p.kernel_size or 0))
        if p.global_pooling and (self.pad, self.stride) != ((0, 0), (1, 1)):
            raise self.fail("global_pooling needs pad 0 and stride 1", "global_pooling")
        if not p.global_pooling and not all(self.kernel):
            raise self.fail("needs kernel_size, or kernel_h and kernel_w, of at least 1", "kernel_size")
        if not all(self.stride):
            raise self.fail("stride must be at least 1", "stride")
        if not p.global_pooling and any(pad >= k for pad, k in zip(self.pad, self.kernel)):
            raise self.fail(f"pad {self.pad} must be smaller than the kernel {self.kernel}", "pad")
        self.whole_kernel = self.kernel
        self.is_max = p.pool == "MAX"

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom[0].shape) != 4 or 0 in bottom[0].shape[2:]:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, expected (N, C, H, W)")
        N, C, H, W = bottom[0].shape
        if self.param.global_pooling:
            self.whole_kernel = (H, W)
        for y in top:
            y.reshape(N, C, self._outputs(0, H), self._outputs(1, W))
        # What hangs over in any case is cut off: it would be padding, and there may be much of it.
        kh, kw = (min(k, n + 2 * p) for k, n, p in zip(self.whole_kernel, (H, W), self.pad))
        self.kernel = (kh, kw)

    def _outputs(self, i: int, size: int) -> int:
        # Return the size of the output in direction i (0 down, 1 across) for an input of this size: round up unless
        # self.param.round_mode is FLOOR; with padding in either direction, any(self.pad), drop a last window that
        # starts beyond the image. The kernel is self.whole_kernel[i]. (Ours also says if no window is left.)
        raise NotImplementedError

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        # Write top[0].data, and the mask into top[1].data if there is one. self.is_max tells MAX from AVE. Keep what
        # backward needs, as self.winners. padded(), windows(), _index() and area() help.
        raise NotImplementedError

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        # If propagate_down[0], write every element of bottom[0].diff: what several windows share is summed, what no
        # window took is 0.
        raise NotImplementedError

    def _index(self, n: int, W: int) -> Array:
        """(C, Ho, Wo): where in its map each winner of an image stands."""
        (_, h, w), (i, j) = np.indices(self.winners[n].shape), np.divmod(self.winners[n], self.kernel[1])
        return (h * self.stride[0] - self.pad[0] + i) * W + w * self.stride[1] - self.pad[1] + j

    def padded(self, x: Array, y_shape: tuple[int, ...], value: float) -> Array:
        """x (C, H, W) with its padding, and with room for the windows that hang over."""
        after = [
            max((outputs - 1) * s + k - n - p, p)
            for outputs, s, k, n, p in zip(y_shape[2:], self.stride, self.kernel, x.shape[1:], self.pad)
        ]
        return np.pad(x, [(0, 0), *zip(self.pad, after)], constant_values=value)

    def windows(self, padded: Array, y_shape: tuple[int, ...]) -> Array:
        """All windows of an image, (kh kw, C, Ho, Wo): row p holds what stands at place p of every window."""
        return np.stack([padded[:, rows, across] for rows, across in self.places(y_shape)])

    def places(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
        """For each place of a window, row by row, the rows and columns of the padded image where it stands."""
        (sh, sw), (Ho, Wo) = self.stride, y_shape[2:]
        for i, j in np.ndindex(self.kernel):
            yield slice(i, i + (Ho - 1) * sh + 1, sh), slice(j, j + (Wo - 1) * sw + 1, sw)

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """(Ho, Wo): size of each window, clipped where the padding ends."""
        sizes = []
        for i in range(2):
            start = np.arange(y_shape[2 + i]) * self.stride[i] - self.pad[i]
            sizes.append(np.minimum(start + self.kernel[i], x_shape[2 + i] + self.pad[i]) - start)
        return np.outer(*sizes).astype(self.dtype)


def _or(value: int | None, default: int) -> int:
    return default if value is None else value
