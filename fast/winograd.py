r"""Winograd: 3 x 3 convolutions with a quarter of the multiplications.

Winograd's F(4 x 4, 3 x 3) (Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016) computes a tile
of 4 x 4 outputs from 6 x 6 inputs d with 36 products:

    y = Aᵀ [(G w Gᵀ) * (Bᵀ d B)] A

The matrices are those of row_winograd.py. Summed over channels, each of the 36 positions is one matrix product over the
tiles of a block. The gradient of x is a convolution of dy with the flipped kernel; that of w is
Gᵀ [sum over tiles of (A dy Aᵀ) * (Bᵀ d B)] G.

The elements of a tile are arrays over all tiles and channels, so a transform is a few sums of long vectors.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np

from fast import parallel
from fast.fusing import After
from fast.geometry import Geometry, image_blocks
from fast.parallel import scratch
from fast.row_winograd import TILE, from_points, kernel_matrix, spread, to_points
from netlib.blob import Array
from netlib.system.memory import blocks

BLOCK_BYTES = 4 << 20  # of both factors of the products of a block; smaller ones take more calls
MIN_TILES = 192  # of a block, because BLAS copies the weights for every product
MIN_PART = 64  # tiles of a thread
KERNEL = 3
SIDE = TILE + KERNEL - 1  # of the inputs of a tile

Part = tuple[slice, slice]  # images, rows of tiles


class Winograd:
    """The algorithm for 3 x 3 kernels, stride 1, without dilation and groups, and many channels."""

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        O, C = w.shape[:2]
        weights = (_gg().astype(w.dtype) @ w.reshape(O * C, -1).T).reshape(SIDE * SIDE, O, C)

        def job(part: Part) -> None:
            images, rows = part
            V = _inputs(g, x[images], rows, y.shape[2:])
            _correlate(weights, V, after, y[images, :, TILE * rows.start : TILE * rows.stop])

        parallel.run([partial(job, part) for part in _blocks(x, y)])

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx."""
        self.correlate(g.turned, dy, g.flipped(w), after, dx)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        O, C = dw.shape[:2]
        parts = list(_blocks(x, dy))
        count = 1 if parallel.is_inside() else parallel.threads()
        lanes = list(blocks(len(parts), -(-len(parts) // count) or 1))
        totals = scratch("totals", (len(lanes), SIDE * SIDE, O, C), dw.dtype)

        def job(number: int, lane: slice) -> None:
            for i, (images, rows) in enumerate(parts[lane]):
                V = _inputs(g, x[images], rows, dy.shape[2:])
                Z = _outputs(dy[images, :, TILE * rows.start : TILE * rows.stop])
                if i == 0:
                    np.matmul(Z, V.swapaxes(1, 2), out=totals[number])
                else:
                    product = scratch("result", totals[0].shape, dw.dtype)
                    totals[number] += np.matmul(Z, V.swapaxes(1, 2), out=product)

        parallel.run([partial(job, number, lane) for number, lane in enumerate(lanes)])
        for total in totals[1:]:
            totals[0] += total
        if lanes:
            dw += (_gg().T.astype(dw.dtype) @ totals[0].reshape(SIDE * SIDE, -1)).T.reshape(dw.shape)


def _gg() -> Array:
    """The matrix (36, 9) of G w Gᵀ as one product."""
    G = kernel_matrix(KERNEL)
    return np.kron(G, G)


def _inputs(g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...]) -> Array:
    """Bᵀ d B of the tiles of these rows, V (36, C, tiles), from x (n, C, H, W)."""
    n, C = x.shape[:2]
    R, T, more = rows.stop - rows.start, -(-outputs[1] // TILE), 1
    padded = scratch("padded", (C, n, R + more, TILE, TILE * (T + more)), x.dtype)
    _place(x.swapaxes(0, 1), g.pad[0] - TILE * rows.start, g.pad[1], padded.reshape(C, n, (R + more) * TILE, -1))
    split = scratch("split", (TILE, SIDE, C, n, R + more, T), x.dtype)
    by_row = padded.transpose(3, 0, 1, 2, 4)
    for column in range(SIDE):
        split[:, column] = by_row[..., column : column + TILE * (T - 1) + 1 : TILE]
    mixed = scratch("mixed", (TILE, SIDE, C * n, (R + more) * T), x.dtype)
    for row in range(TILE):
        to_points(KERNEL, split[row].reshape(SIDE, C * n, -1), mixed[row])
    V = scratch("inputs", (SIDE, SIDE * C * n, R * T), x.dtype)
    whole = mixed.reshape(TILE, SIDE * C * n, -1)
    elements = [whole[i % TILE, :, i // TILE * T : (i // TILE + R) * T] for i in range(SIDE)]
    to_points(KERNEL, elements, V)
    return V.reshape(SIDE * SIDE, C, -1)


def _place(x: Array, top: int, left: int, out: Array) -> None:
    """Write x (C, n, H, W) to ``out`` from row ``top`` and column ``left``, with zeros around it."""
    (H, W), (high, wide) = x.shape[2:], out.shape[2:]
    first, end = min(max(top, 0), high), min(max(top + H, 0), high)
    start, stop = min(max(left, 0), wide), min(max(left + W, 0), wide)
    out[:, :, :first] = out[:, :, end:] = 0
    inner = out[:, :, first:end]
    inner[..., :start] = inner[..., stop:] = 0
    inner[..., start:stop] = x[:, :, first - top : end - top, start - left : stop - left]


def _correlate(weights: Array, V: Array, after: After, y: Array) -> None:
    """Write the rows y (n, O, rows, Wo) of one block."""
    n, O, rows, Wo = y.shape
    R, T = -(-rows // TILE), -(-Wo // TILE)
    products = scratch("products", (SIDE * SIDE, O, n * R * T), y.dtype)
    np.matmul(weights, V, out=products)
    halves = scratch("mixed", (TILE, SIDE, n * R * T * O), y.dtype)
    from_points(KERNEL, products.reshape(SIDE, 1, -1), halves.reshape(TILE, 1, -1))
    sums = scratch("split", (TILE, O * n * R, T), y.dtype)
    merged = scratch("padded", (O * n * R, T, TILE), y.dtype)
    by_channel = y.swapaxes(0, 1)
    for row in range(TILE):
        target = by_channel[:, :, row::TILE]
        from_points(KERNEL, halves[row].reshape(SIDE, 1, -1), sums.reshape(TILE, 1, -1))
        cv2.merge(list(sums), merged)
        after.write(merged.reshape(O, n, R, -1)[:, :, : target.shape[2], :Wo], target, slice(0, O))


def _outputs(dy: Array) -> Array:
    """A dy Aᵀ of the tiles of dy (n, O, rows, Wo), Z (36, O, tiles)."""
    n, O, rows, Wo = dy.shape
    R, T = -(-rows // TILE), -(-Wo // TILE)
    padded = scratch("padded", (O, n, R, TILE, TILE * T), dy.dtype)
    _place(dy.swapaxes(0, 1), 0, 0, padded.reshape(O, n, R * TILE, -1))
    split = scratch("split", (TILE, TILE, O * n * R * T), dy.dtype)
    by_row = padded.transpose(3, 0, 1, 2, 4)
    for column in range(TILE):
        split[:, column].reshape(TILE, O, n, R, T)[...] = by_row[..., column::TILE]
    mixed = scratch("mixed", (TILE, SIDE, O * n * R * T), dy.dtype)
    for row in range(TILE):
        spread(KERNEL, split[row], mixed[row])
    Z = scratch("products", (SIDE, SIDE * O * n * R * T), dy.dtype)
    spread(KERNEL, mixed.reshape(TILE, -1), Z)
    return Z.reshape(SIDE * SIDE, O, -1)


def _blocks(x: Array, y: Array) -> Iterator[Part]:
    """The images and rows of tiles of each block; at least one for each thread outside of slices."""
    tiles = -(-y.shape[2] // TILE), -(-y.shape[3] // TILE)
    each = max(BLOCK_BYTES // (SIDE * SIDE * (x.shape[1] + y.shape[1]) * x.itemsize), MIN_TILES)
    if not parallel.is_inside():
        each = min(each, max(-(-len(x) * tiles[0] * tiles[1] // parallel.threads()), MIN_PART))
    return image_blocks(len(x), tiles, each)
