r"""Winograd: 3 x 3 convolutions with 4 instead of 9 multiplications per output and channel.

Winograd's F(2 x 2, 3 x 3) (Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016) computes a tile
of 2 x 2 outputs from 4 x 4 inputs d with 16 products:

    y = Aᵀ [(G w Gᵀ) * (Bᵀ d B)] A      Bᵀ = 1  0 -1  0     G = 1    0   0      Aᵀ = 1  1  1  0
                                             0  1  1  0         1/2  1/2 1/2         0  1 -1 -1
                                             0 -1  1  0         1/2 -1/2 1/2
                                             0  1  0 -1         0    0   1

Summed over channels, each of the 16 positions is one matrix product over all tiles of several images. All factors are
small, so the result is as accurate as that of one large product. The gradient of x is a convolution of dy with the
flipped kernel; that of w is Gᵀ [sum over tiles of (A dy Aᵀ) * (Bᵀ d B)] G.

Inputs and outputs are split by odd and even rows and columns. Each array has one more column than tiles, so a tile's
right neighbour is the next value in memory, and a transform is a few sums of long vectors.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fast.fusing import After
from fast.geometry import Geometry, image_blocks, run_parts
from fast.parallel import scratch
from netlib.blob import Array

BLOCK_BYTES = 4 << 20  # of both factors of the products of a block
MIN_TILES = 192  # of a block, because BLAS copies the weights for every product
TRANSFORM = 300  # multiplications that take as long as the transforms of a tile and channel

G = np.array([[1, 0, 0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0, 0, 1]])
GG = np.kron(G, G)  # (16, 9): G w Gᵀ as one product


class Winograd:
    """The algorithm for 3 x 3 kernels, stride 1, without dilation and groups, and many channels."""

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        O, C = w.shape[:2]
        weights = (GG.astype(w.dtype) @ w.reshape(O * C, 9).T).reshape(16, O, C)
        for images, rows in _blocks(x, y):
            V = _inputs(g, x[images], rows, y.shape[2:])
            _correlate(weights, V, after, y[images, :, 2 * rows.start : 2 * rows.stop])

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx."""
        self.correlate(g.turned, dy, g.flipped(w), after, dx)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        O, C = dw.shape[:2]
        total = np.zeros((16, O, C), dw.dtype)
        for images, rows in _blocks(x, dy):
            V = _inputs(g, x[images], rows, dy.shape[2:])
            _gradient(V, dy[images, :, 2 * rows.start : 2 * rows.stop], total)
        dw += (GG.T.astype(dw.dtype) @ total.reshape(16, -1)).T.reshape(dw.shape)


def _inputs(g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...]) -> Array:
    """Bᵀ d B of the tiles of these rows, V (16, C, tiles), from x (n, C, H, W)."""
    n, C = x.shape[:2]
    R, T = rows.stop - rows.start, -(-outputs[1] // 2) + 1
    split = scratch("split", (2, 2, C, n, (R + 1) * T), x.dtype)
    mixed = scratch("mixed", (4, 2, C, n, R * T), x.dtype)
    V = scratch("inputs", (4, 4, C, n, R * T), x.dtype)

    def job(c: slice) -> None:
        for row in range(2):
            for column in range(2):
                part = split[row, column, c].reshape(-1, n, R + 1, T)
                _every_second(x[:, c].swapaxes(0, 1), 2 * rows.start + row - g.pad[0], column - g.pad[1], part)
        even, odd = split[0, :, c], split[1, :, c]
        first, third = even[..., : R * T], even[..., T:]
        second, fourth = odd[..., : R * T], odd[..., T:]
        np.subtract(first, third, out=mixed[0, :, c])
        np.add(second, third, out=mixed[1, :, c])
        np.subtract(third, second, out=mixed[2, :, c])
        np.subtract(second, fourth, out=mixed[3, :, c])
        left, right = mixed[:, 0, c], mixed[:, 1, c]
        V[:, :, c, :, -1] = 0
        np.subtract(left[..., :-1], left[..., 1:], out=V[:, 0, c, :, :-1])
        np.add(right[..., :-1], left[..., 1:], out=V[:, 1, c, :, :-1])
        np.subtract(left[..., 1:], right[..., :-1], out=V[:, 2, c, :, :-1])
        np.subtract(right[..., :-1], right[..., 1:], out=V[:, 3, c, :, :-1])

    run_parts(job, C, 1, V.size * TRANSFORM / 16)
    return V.reshape(16, C, -1)


def _every_second(x: Array, top: int, left: int, out: Array) -> None:
    """Write every second row and column of x (C, n, H, W) to out (C, n, R, T), from (top, left), and 0 outside of x."""
    (H, W), (R, T) = x.shape[2:], out.shape[2:]
    h, v = _range(top, H, R), _range(left, W, T)
    out[:, :, : h.start] = out[:, :, h.stop :] = 0
    out[:, :, h, : v.start] = out[:, :, h, v.stop :] = 0
    rows = slice(top + 2 * h.start, top + 2 * h.stop, 2) if h.stop > h.start else slice(0, 0)
    columns = slice(left + 2 * v.start, left + 2 * v.stop, 2) if v.stop > v.start else slice(0, 0)
    out[:, :, h, v] = x[:, :, rows, columns]


def _range(first: int, size: int, count: int) -> slice:
    """Which of ``count`` positions first, first + 2, ... are from 0 to size - 1."""
    start = min(max(-(first // 2), 0), count)
    return slice(start, max(start, min((size - first + 1) // 2, count)))


def _correlate(weights: Array, V: Array, after: After, y: Array) -> None:
    """Write the rows y (n, O, rows, Wo) of one block."""
    n, O, rows, Wo = y.shape
    R, T = -(-rows // 2), -(-Wo // 2) + 1
    products = scratch("products", (4, 4, O, n * R * T), y.dtype)
    halves = scratch("halves", (2, 4, O, n * R * T), y.dtype)
    sums = scratch("sums", (2, O, n * R * T), y.dtype)
    by_channel = y.swapaxes(0, 1)

    def job(o: slice) -> None:
        np.matmul(weights[:, o], V, out=products.reshape(16, O, -1)[:, o])
        m, s, pair = products[:, :, o], halves[:, :, o], sums[:, o]
        _combine(m[0], m[1], m[2], m[3], s)
        for row in range(2):
            _combine(s[row, 0], s[row, 1], s[row, 2], s[row, 3], pair)
            for column in range(2):
                target = by_channel[o, :, row::2, column::2]
                values = pair[column].reshape(-1, n, R, T)[:, :, : target.shape[2], : target.shape[3]]
                after.write(values, target, o)

    run_parts(job, O, 1, weights.size * n * R * T)


def _combine(a: Array, b: Array, c: Array, d: Array, out: Array) -> None:
    """Write Aᵀ (a, b, c, d) to out[0] and out[1]."""
    np.add(b, c, out=out[0])
    out[0] += a
    np.subtract(b, c, out=out[1])
    out[1] -= d


def _gradient(V: Array, dy: Array, total: Array) -> None:
    """Add the products of one block to total (16, O, C)."""
    n, O, rows, Wo = dy.shape
    R, T = -(-rows // 2), -(-Wo // 2) + 1
    split = scratch("split", (2, 2, O, n, R, T), dy.dtype)
    mixed = scratch("mixed", (4, 2, O, n, R, T), dy.dtype)
    Z = scratch("products", (4, 4, O, n * R * T), dy.dtype)
    by_channel = dy.swapaxes(0, 1)

    def job(o: slice) -> None:
        for row in range(2):
            for column in range(2):
                _every_second(by_channel[o], row, column, split[row, column, o])
        _spread(split[:, :, o], mixed[:, :, o])
        _spread(mixed[:, :, o].swapaxes(0, 1), Z[:, :, o].reshape(4, 4, -1, n, R, T).swapaxes(0, 1))
        total[:, o] += Z.reshape(16, O, -1)[:, o] @ V.swapaxes(1, 2)

    run_parts(job, O, 1, total.size * n * R * T)


def _spread(pair: Array, out: Array) -> None:
    """Write A (pair[0], pair[1]) to out[0] to out[3]."""
    out[0] = pair[0]
    np.add(pair[0], pair[1], out=out[1])
    np.subtract(pair[0], pair[1], out=out[2])
    np.negative(pair[1], out=out[3])


def _blocks(x: Array, y: Array) -> Iterator[tuple[slice, slice]]:
    """The images and rows of tiles of each block."""
    tiles = -(-y.shape[2] // 2), -(-y.shape[3] // 2) + 1
    bytes_each = 16 * (x.shape[1] + y.shape[1]) * x.itemsize
    return image_blocks(len(x), tiles, max(BLOCK_BYTES // bytes_each, MIN_TILES))
