"""Pooling: the maximum or the mean of a window that slides over each channel.

bottom[0]  x  (N, C, H, W)
top[0]     y  (N, C, ceil((H + 2 pad - kernel) / stride) + 1, same for W)

MAX   y = max of x over the window             dx[winner] += dy
AVE   y = sum of x over the window / area      dx[each of the window] += dy / area

Caffe's rules: the output size is rounded **up**, so a last window may hang over the edge; with pad > 0 a last
window that starts in the padding is dropped. MAX takes the first of equal values and never a pad. The area of
AVE counts padding, but not what hangs over it. A window without any value (stride > kernel) gives -FLT_MAX or NaN.

Kept for backward: ``winners``, for each output of MAX the place in its window, row by row.

Square windows side by side, as the hand network has them, are computed by max_tiles.py; any others here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.max_tiles import MaxTiles
from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.schema import Engine, UInt

NOTHING = -float(np.finfo(np.float32).max)  # Caffe's maximum over no values
NO_WINNER = np.uint32(0xFFFFFFFF)


@dataclass(frozen=True)
class PoolingParameter:
    """The ``pooling_param { ... }`` block."""

    pool: Literal["MAX", "AVE", "STOCHASTIC"] = "MAX"
    kernel_size: UInt | None = None
    kernel_h: UInt | None = None
    kernel_w: UInt | None = None
    pad: UInt = 0
    pad_h: UInt | None = None
    pad_w: UInt | None = None
    stride: UInt = 1
    stride_h: UInt | None = None
    stride_w: UInt | None = None
    global_pooling: bool = False  # one window, the whole map
    round_mode: Literal["CEIL", "FLOOR"] = "CEIL"
    engine: Engine = "DEFAULT"  # Caffe's choice of implementation; accepted, ignored


class Pooling(Layer):
    """Spatial pooling."""

    param_type = PoolingParameter
    bottoms = tops = (1, 1)
    in_place = False
    batchwise = True
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.pool == "STOCHASTIC":
            raise self.fail("STOCHASTIC pooling is not supported; expected MAX or AVE", "pool")
        block = self.spec.blocks.get("pooling_param")
        for both, each in (("kernel_size", "kernel"), ("pad", "pad"), ("stride", "stride")):
            if block and block.values(both) and (block.values(f"{each}_h") or block.values(f"{each}_w")):
                raise self.fail(f"give either {both}, or {each}_h and {each}_w", both)
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
        self.is_max = p.pool == "MAX"
        self.takes_maximum = self.is_max and all(s <= k for s, k in zip(self.stride, self.kernel))  # of something
        k = self.kernel[0]
        plain_windows = self.kernel == self.stride == (k, k) and self.pad == (0, 0) and p.round_mode == "CEIL"
        self.tile = k if self.is_max and plain_windows and 1 < k <= 15 else None

    def bottom_tile(self, bottom_index: int, top_tile: int | None) -> int | None:
        return self.tile

    def writes_tiles(self) -> bool:
        return self.tile is not None

    def sparse_tiles(self) -> bool:
        return self.tile is not None

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom[0].shape) != 4:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, expected (N, C, H, W)")
        N, C, H, W = bottom[0].shape
        if self.param.global_pooling:
            self.kernel = (H, W)
        top[0].reshape(N, C, self._outputs(0, H), self._outputs(1, W))
        if self.tile:
            self.tiles = MaxTiles(self, self.tile, bottom[0], top[0])
        elif self.is_max:
            self.winners = np.empty(top[0].shape, np.uint32)

    def _outputs(self, i: int, size: int) -> int:
        extent = size + 2 * self.pad[i] - self.kernel[i]
        if extent < 0:
            raise self.fail(f"kernel {self.kernel[i]} is larger than the padded bottom ({size} + 2 * {self.pad[i]})")
        count = (-(-extent // self.stride[i]) if self.param.round_mode == "CEIL" else extent // self.stride[i]) + 1
        if self.pad[i] and (count - 1) * self.stride[i] >= size + self.pad[i]:
            count -= 1
        return count

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if self.tile:
            self.tiles.forward(bottom[0], top[0])
        elif self.is_max:
            self._forward_max(bottom[0].data, top[0].data)
        else:
            self._forward_mean(bottom[0].data, top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        if self.tile:
            self.tiles.backward(top[0], bottom[0])
        elif self.is_max:
            self._backward_max(top[0].diff, bottom[0].diff)
        else:
            self._backward_mean(top[0].diff, bottom[0].diff)

    # ------------------------------------------------------------------------------------------ any window
    # One pass for each place of the window: the values that stand there, for all windows at once.

    def _padded(self, x: Array, outputs: tuple[int, ...], value: float) -> Array:
        """x with its padding, and with room for the windows that hang over."""
        N, C, H, W = x.shape
        rows, columns = (
            max((o - 1) * s + k, n + 2 * p)
            for o, s, k, n, p in zip(outputs[2:], self.stride, self.kernel, (H, W), self.pad)
        )
        padded = np.full((N, C, rows, columns), value, x.dtype)
        padded[:, :, self.pad[0] : self.pad[0] + H, self.pad[1] : self.pad[1] + W] = x
        return padded

    def _places(self, padded: Array, outputs: tuple[int, ...]) -> list[Array]:
        """For each place of the window a view (N, C, outputs)."""
        (Ho, Wo), (sh, sw), (kh, kw) = outputs[2:], self.stride, self.kernel
        return [
            padded[:, :, i : i + (Ho - 1) * sh + 1 : sh, j : j + (Wo - 1) * sw + 1 : sw]
            for i in range(kh)
            for j in range(kw)
        ]

    def _forward_max(self, x: Array, y: Array) -> None:
        if self.kernel == x.shape[2:] and self.pad == (0, 0) and y.shape[2:] == (1, 1):  # one window
            flat = x.reshape(*x.shape[:2], -1)
            self.winners[...] = flat.argmax(axis=2)[..., None, None]
            y[...] = flat.max(axis=2)[..., None, None]
            return
        y[...] = -np.inf
        self.winners[...] = NO_WINNER
        for place, value in enumerate(self._places(self._padded(x, y.shape, -np.inf), y.shape)):
            self.winners[value > y] = place
            np.maximum(y, value, out=y)
        y[np.isneginf(y)] = NOTHING

    def _backward_max(self, dy: Array, dx: Array) -> None:
        padded = self._padded(np.zeros_like(dx), dy.shape, 0)
        for place, gradient in enumerate(self._places(padded, dy.shape)):
            gradient += dy * (self.winners == place)
        dx[...] = self._inner(padded, dx.shape)

    def _forward_mean(self, x: Array, y: Array) -> None:
        y[...] = 0
        for value in self._places(self._padded(x, y.shape, 0), y.shape):
            y += value
        with np.errstate(invalid="ignore", divide="ignore"):  # an empty window is 0 / 0
            y /= self._area(x.shape, y.shape)

    def _backward_mean(self, dy: Array, dx: Array) -> None:
        padded = self._padded(np.zeros_like(dx), dy.shape, 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = dy / self._area(dx.shape, dy.shape)
        for gradient in self._places(padded, dy.shape):
            gradient += share
        dx[...] = self._inner(padded, dx.shape)

    def _inner(self, padded: Array, shape: tuple[int, ...]) -> Array:
        return padded[:, :, self.pad[0] : self.pad[0] + shape[2], self.pad[1] : self.pad[1] + shape[3]]

    def _area(self, inputs: tuple[int, ...], outputs: tuple[int, ...]) -> Array:
        """(Ho, Wo): size of each window, clipped where the padding ends."""
        sizes = []
        for i in range(2):
            start = np.arange(outputs[2 + i]) * self.stride[i] - self.pad[i]
            sizes.append(np.minimum(start + self.kernel[i], inputs[2 + i] + self.pad[i]) - start)
        return np.outer(*sizes).astype(self.dtype)


def _or(value: int | None, default: int) -> int:
    return default if value is None else value
