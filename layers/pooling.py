"""Pooling: the maximum or the mean of a window that slides over each channel.

bottom[0]  x  (N, C, H, W)
top[0]     y  (N, C, ceil((H + 2 pad - kernel) / stride) + 1, same for W)

MAX   y = max of x over the window             dx[winner] += dy
AVE   y = sum of x over the window / area      dx[each of the window] += dy / area

Caffe's rules: the output size is rounded **up**, so a last window may hang over the edge; with pad > 0 a last
window that starts in the padding is dropped. MAX takes the first of equal values and never a pad. The area of
AVE counts padding, but not what hangs over it. A window without any value (stride > kernel) gives -FLT_MAX or NaN.

Kept for backward: ``winners``, for each output of MAX the place in its window, row by row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlib.blob import Array, Blob, Blobs, SparseTiles, plain_of, tiles_of, untile
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
        self.takes_maximum = p.pool == "MAX"
        k = self.kernel[0]
        plain_windows = self.kernel == self.stride == (k, k) and self.pad == (0, 0) and p.round_mode == "CEIL"
        self.tile = k if self.takes_maximum and plain_windows and 1 < k <= 15 else None

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
            self._reshape_tiles(bottom[0], top[0])
        elif self.takes_maximum:
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
        if bottom[0].sparse is not None:
            self._forward_sparse(bottom[0].sparse, top[0])
        elif self.tile:
            self._forward_tiles(bottom[0], top[0])
        elif self.takes_maximum:
            self._forward_max(bottom[0].data, top[0].data)
        else:
            self._forward_mean(bottom[0].data, top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        if bottom[0].sparse is not None:
            self._backward_sparse(top[0], bottom[0].sparse)
        elif self.tile:
            self._backward_tiles(top[0], bottom[0])
        elif self.takes_maximum:
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
        if y.shape[2:] == (1, 1) and self.kernel == x.shape[2:]:  # one window
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

    # ------------------------------------------------------------------------------------------ tiles
    # Windows side by side, T x T, on a tiled blob (netlib/blob.py): the T*T values of a window stand in T*T
    # slabs, each contiguous over channels, images and windows of a row of windows. So the maximum is taken
    # between long vectors, and a winner is a small integer.

    def _reshape_tiles(self, bottom: Blob, top: Blob) -> None:
        T = self.tile
        assert T is not None
        N, C, H, W = bottom.shape
        self.pitch = bottom.pitch if bottom.tile == T else -(-W // T) * T
        if top.tile is not None:
            top.pitch = -(-(self.pitch // T) // top.tile) * top.tile
        self.slabs = (-(-H // T), T * T, C * N * (self.pitch // T))  # rows of windows, places, windows of a row
        self.winners = np.empty((self.slabs[0], self.slabs[2]), np.uint8)
        self.rank = np.arange(T * T, 0, -1, dtype=np.uint8)[:, None]  # the first place ranks highest

    def _forward_tiles(self, bottom: Blob, top: Blob) -> None:
        T = self.tile
        assert T is not None
        N, C, H, W = bottom.shape
        R, places, L = self.slabs
        storage = (R * T, T, C, N, self.pitch // T)
        out = self.buffer("values", storage) if bottom.tile != T else bottom.data
        x = tiles_of(bottom, bottom.data, T, self.pitch, out)
        self._fill_overhang(x, H, W, -np.inf)  # windows that hang over the edge must not see padding
        slabs = x.reshape(R, places, L)
        y = self._dense_rows(top, top.data)
        np.max(slabs, axis=1, out=y.reshape(R, L))
        if self.needs_backward:
            self._find_winners(slabs, y.reshape(R, 1, L), self.winners)
        self._fill_overhang(x, H, W, 0)  # others, who read x again, must not see infinity
        y[..., -(-W // T) :] = 0  # windows of padding only
        self._store_rows(y, top, top.data)

    def _fill_overhang(self, x: Array, H: int, W: int, value: float) -> None:
        """Set the padding inside the last row and column of windows."""
        T = x.shape[1]
        x[H:] = value
        for phase in range(W % T or T, T):
            x[:, phase, ..., W // T] = value

    def _find_winners(self, slabs: Array, maximum: Array, winners: Array) -> None:
        """Of (..., places, L) values the first place that holds the maximum."""
        first = self.buffer("first", slabs.shape, np.uint8)
        np.equal(slabs, maximum, out=first.view(bool))
        first *= self.rank
        np.subtract(np.uint8(len(self.rank)), first.max(axis=-2), out=winners)
        np.minimum(winners, np.uint8(len(self.rank) - 1), out=winners)  # a NaN equals nothing, not even itself

    def _backward_tiles(self, top: Blob, bottom: Blob) -> None:
        T = self.tile
        assert T is not None
        C, N = bottom.shape[1], bottom.shape[0]
        R, places, L = self.slabs
        dy = self._load_rows(top, top.diff)
        direct = bottom.tile == T
        dx = bottom.diff if direct else self.buffer("dx", (R * T, T, C, N, self.pitch // T))
        dx.fill(0)
        index = self.winners.astype(np.intp)  # where each winner stands in dx
        index *= L
        index += (np.arange(R)[:, None] * (places * L)) + np.arange(L)
        dx.reshape(-1)[index.reshape(-1)] = dy.reshape(-1)
        if not direct:
            bottom.diff[...] = untile(dx, *bottom.shape[2:])

    # The top in rows of windows, (R, C, N, windows of a row): the top itself if it is stored so, else a buffer.

    def _dense_rows(self, top: Blob, array: Array) -> Array:
        shape = (self.slabs[0], top.shape[1], top.shape[0], self.pitch // (self.tile or 1))
        return array.reshape(shape) if self._stores_rows(top) else self.buffer("rows", shape)

    def _stores_rows(self, top: Blob) -> bool:
        return top.tile == 1 and top.pitch == self.pitch // (self.tile or 1)

    def _store_rows(self, y: Array, top: Blob, out: Array) -> None:
        if self._stores_rows(top):
            return
        plain = untile(y[:, None], *top.shape[2:])
        if top.tile is None:
            out[...] = plain
        else:
            tiles_of(Blob(top.shape, top.dtype), plain, top.tile, top.pitch, out)

    def _load_rows(self, top: Blob, array: Array) -> Array:
        rows = self._dense_rows(top, array)
        if not self._stores_rows(top):
            rows[..., top.shape[3] :] = 0
            rows[..., : top.shape[3]] = plain_of(top, array).transpose(2, 1, 0, 3)
        return rows

    # ------------------------------------------------------------------------------------------ sparse tiles
    # The same on the windows that are stored; all others have the maximum ``rest``, and their first place wins.

    def _forward_sparse(self, x: SparseTiles, top: Blob) -> None:
        places, C, A = x.values.shape
        slabs = x.values.reshape(places, C * A)
        maximum = slabs.max(axis=0)
        if self.needs_backward:
            self.winners = np.empty(C * A, np.uint8)
            self._find_winners(slabs, maximum, self.winners)
        y = self._tiled(top, top.data)
        y[...] = x.rest[:, None, None]
        y.reshape(-1)[self._places_in(y, x)] = maximum
        if top.tile is None:
            top.data[...] = untile(y, *top.shape[2:])

    def _backward_sparse(self, top: Blob, x: SparseTiles) -> None:
        dy = self._tiled(top, top.diff)
        if top.tile is None:
            tiles_of(top, top.diff, 1, dy.shape[-1], dy)
        gradient = dy.reshape(-1)[self._places_in(dy, x)].reshape(dy.shape[2], -1)
        C, A = gradient.shape
        total = dy.sum(axis=(0, 1, 3, 4), dtype=np.float64) - gradient.sum(axis=1, dtype=np.float64)
        x.rest_diff = total.astype(self.dtype)
        places = len(self.rank)
        diff = self.buffer("sparse", (places * self.slabs[0] * self.slabs[2],))[: places * C * A]
        diff.fill(0)
        index = self.winners.astype(np.intp)
        index *= C * A
        index += np.arange(C * A)
        diff[index] = gradient.reshape(-1)
        x.diff = diff.reshape(places, C, A)

    def _tiled(self, top: Blob, array: Array) -> Array:
        """The top as tiles: as it is stored, or a buffer for tiles of 1."""
        N, C, Ho, Wo = top.shape
        return array if top.tile else self.buffer("top", (Ho, 1, C, N, Wo))

    def _places_in(self, tiles: Array, x: SparseTiles) -> Array:
        """Index of every stored window and channel, (C A,), in the top as tiles (R, T, C, N, P)."""
        _, T, C, N, P = tiles.shape
        t, phase = np.divmod(x.column, T)
        index = ((x.row * T + phase) * (C * N) + x.image) * P + t
        return (np.arange(C)[:, None] * (N * P) + index).reshape(-1)


def _or(value: int | None, default: int) -> int:
    return default if value is None else value
