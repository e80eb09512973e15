r"""Winograd: 3 x 3 convolutions with a quarter of the multiplications.

Winograd's F(4 x 4, 3 x 3) (Lavin and Gray, "Fast algorithms for convolutional neural networks",
2016) computes a tile of 4 x 4 outputs from 6 x 6 inputs d with 36 products:

    y = Aᵀ [(G w Gᵀ) * (Bᵀ d B)] A

The matrices are those of row_winograd.py. Summed over channels, each of the 36 positions is one
matrix product over the tiles of a block. The gradient of x is a convolution of dy with the flipped
kernel; that of w is Gᵀ [sum over tiles of (A dy Aᵀ) * (Bᵀ d B)] G.

The rows and columns of tiles are transformed by one product of all tiles with the matrix, because
two threads wait for each other between calls. Only the rows of d, which overlap, are combined by
sums of long vectors.

The limits were measured with 16 to 512 channels and 7 to 224 pixels, on two cores with AVX-512.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache, partial

import cv2
import numpy as np

from fast import parallel
from fast.fusing import After
from fast.geometry import (
    MAX_EXCESS,
    Algorithm,
    Geometry,
    Sizes,
    Sum,
    check_finite,
    check_spread,
    image_blocks,
)
from fast.parallel import equal_blocks, scratch
from fast.row_winograd import TILE, as_units, input_matrix, kernel_matrix, output_matrix, transform
from netlib.blob import Array, blocks, divide_up

BLOCK_BYTES = 4 << 20  # of both factors of the products of a block; smaller ones take more calls
MIN_TILES = 192  # of a block, because BLAS copies the weights for every product
MIN_PART = 64  # tiles of a thread
FEW_TILES = 256  # of a batch, up to which transforming the weights takes a large part of the time
WEIGHT_BYTES = 5 << 19  # of the transformed weights of a block of outputs
MIN_OUTPUTS = 32  # of such a block
# multiplications of the products, from which several threads save more than their calls take
MIN_COST = 100_000_000
KERNEL = 3
SIDE = TILE + KERNEL - 1  # of the inputs of a tile

Block = tuple[slice, slice]  # images, rows of tiles


class Winograd(Algorithm):
    """The algorithm for 3 x 3 kernels, stride 1, without dilation and groups, and many channels."""

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """3 x 3, with enough channels to make the time of the transforms small, more if the last
        tiles extend far beyond the map, and enough tiles to make that of the weights small. Up to
        twice as fast.

        For dw with fewer channels, and with more tiles, because each block adds four times as many
        values as the weights have.
        """
        if sum_ == "transpose" or s.geometry.kernel != (KERNEL, KERNEL) or not s.geometry.is_dense:
            return False
        if s.geometry.group > 1 or s.excess > MAX_EXCESS:
            return False
        tiles = [divide_up(n, TILE) for n in s.windows]
        channels = s.inputs * s.outputs / (s.inputs + s.outputs)
        if sum_ == "gradient":
            return s.images * math.prod(tiles) >= 96 and channels >= 12
        waste = math.prod(count * TILE / n for count, n in zip(tiles, s.windows))
        return s.images * math.prod(tiles) >= 24 and channels >= 20 * waste**3

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y (N, O, Ho, Wo): x (N, C, H, W) correlated with w (O, C, 3, 3), then ``after``.

        Raises NotFiniteError.
        """
        if 0 < len(x) * math.prod(_tiles(y)) <= FEW_TILES:
            _correlate_few(g, x, w, after, y)
            return
        weights = _weights(w, scratch("weights", (SIDE * SIDE, *w.shape[:2]), w.dtype))

        def job(part: Block) -> None:
            images, rows = part
            V = _inputs(g, x[images], rows, y.shape[2:])
            V = V.reshape(SIDE * SIDE, x.shape[1], -1)
            target = y[images, :, TILE * rows.start : TILE * rows.stop]
            _correlate(weights, V, x[images], after, target)

        parallel.run([partial(job, part) for part in _blocks(x, y)])

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw (O, C, 3, 3), from x (N, C, H, W) and dy (N, O, Ho, Wo).

        Raises NotFiniteError.
        """
        O, C = dw.shape[:2]
        parts = list(_blocks(x, dy))
        count = 1 if parallel.is_inside() else parallel.threads()
        lanes = equal_blocks(len(parts), count)
        totals = scratch("totals", (len(lanes), SIDE * SIDE, O, C), dw.dtype)

        def job(number: int, lane: slice) -> None:
            for i, (images, rows) in enumerate(parts[lane]):
                V = _inputs(g, x[images], rows, dy.shape[2:]).reshape(SIDE * SIDE, C, -1)
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
            found = _weight_matrix().T.astype(dw.dtype) @ totals[0].reshape(SIDE * SIDE, -1)
            check_finite(found)
            dw += found.T.reshape(dw.shape)


@lru_cache
def _weight_matrix() -> Array:
    """The matrix (36, 9) of G w Gᵀ as one product."""
    G = kernel_matrix(KERNEL)
    return np.kron(G, G)


def _correlate_few(g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
    """Write y by blocks of outputs, whose transformed weights stay in the cache; all blocks read
    the same transformed inputs.
    """
    N, C, O, (R, T) = len(x), x.shape[1], len(w), _tiles(y)
    V = scratch("shared", (SIDE, SIDE * C * N, R * T), x.dtype)

    def transform_inputs(rows: slice) -> None:
        first, end = rows.start * T, rows.stop * T
        _inputs(g, x, rows, y.shape[2:], V[..., first:end])

    def write_outputs(o: slice) -> None:
        weights = _weights(w[o], scratch("weights", (SIDE * SIDE, o.stop - o.start, C), w.dtype))
        _correlate(weights, V.reshape(SIDE * SIDE, C, -1), x, after.part(o), y[:, o])

    cost = SIDE * SIDE * O * C * N * R * T
    threads = parallel.threads() if cost >= MIN_COST else 1
    cached = WEIGHT_BYTES // (SIDE * SIDE * C * w.itemsize)
    each = min(max(cached, MIN_OUTPUTS), divide_up(O, threads))
    of_rows = [partial(transform_inputs, rows) for rows in equal_blocks(R, threads)]
    of_outputs = [partial(write_outputs, o) for o in blocks(O, each)]
    parallel.run(of_rows, here=threads == 1)
    parallel.run(of_outputs, here=threads == 1)


def _weights(w: Array, out: Array) -> Array:
    """Write G w Gᵀ of w (O, C, 3, 3) to out (36, O, C)."""
    transform(_weight_matrix(), w.reshape(-1, KERNEL * KERNEL).T, out)
    return out


def _inputs(
    g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...], V: Array | None = None
) -> Array:
    """Bᵀ d B of the tiles of these rows, V (6, 6 C n, tiles of an image), from x (n, C, H, W).

    The rows of d are transformed by one product with all tiles, for which each tile is copied with
    the one to the right of it.
    """
    n, C = x.shape[:2]
    R, T, L = rows.stop - rows.start, divide_up(outputs[1], TILE), C * n
    padded = scratch("padded", (TILE, C, n, R + 1, TILE * (T + 1)), x.dtype)
    _place(x.swapaxes(0, 1), g.pad[0] - TILE * rows.start, g.pad[1], padded)
    tiles = as_units(padded.reshape(TILE, L, R + 1, T + 1, TILE))
    pairs = scratch("split", (TILE, L, R + 1, T, 2 * TILE), x.dtype)
    halves = as_units(pairs.reshape(*pairs.shape[:-1], 2, TILE))
    halves[..., 0] = tiles[..., :-1]
    halves[..., 1] = tiles[..., 1:]
    mixed = scratch("mixed", (TILE, SIDE, L * (R + 1) * T), x.dtype)
    windows = pairs.reshape(TILE, -1, 2 * TILE)[..., :SIDE]
    np.matmul(input_matrix(KERNEL).astype(x.dtype), windows.swapaxes(1, 2), out=mixed)
    whole = mixed.reshape(TILE, SIDE * L, (R + 1) * T)
    if V is None:
        V = scratch("inputs", (SIDE, SIDE * L, R * T), x.dtype)
    elements = []
    for i in range(SIDE):
        row, phase = divmod(i, TILE)
        elements.append(whole[phase, :, row * T : (row + R) * T])
    _combine(elements, V)
    return V


def _combine(rows: Sequence[Array], out: Array) -> None:
    """Write Bᵀ rows to out (SIDE, ...), from SIDE arrays that are not adjacent, by sums
    of long vectors.
    """
    even, odd = scratch("temporary", (2, *out[0].shape), out.dtype)
    first, *pairs, last = input_matrix(KERNEL).tolist()
    _add(first[0::2], rows[0::2], out[0])
    _add(last[1::2], rows[1::2], out[-1])
    # The rows between are in pairs, for the points p and -p: even + p odd and even - p odd.
    for i, factors in enumerate(pairs[0::2]):
        point = factors[3]
        _add(factors[2::2], rows[2::2], even)
        _add([factors[1] / point, 1.0], rows[1:4:2], odd)
        cv2.scaleAdd(odd, point, even, dst=out[2 * i + 1])
        cv2.scaleAdd(odd, -point, even, dst=out[2 * i + 2])


def _add(factors: Sequence[float], rows: Sequence[Array], out: Array) -> None:
    """Write the sum of factors times rows, of which the last factor is 1."""
    total = rows[-1]
    for factor, row in zip(factors[:-1], rows[:-1]):
        total = cv2.scaleAdd(row, factor, total, dst=out)


def _place(x: Array, top: int, left: int, out: Array) -> None:
    """Write x (C, n, H, W) to ``out`` from row ``top`` and column ``left``, with zeros around it.

    Row r of ``out`` (TILE, C, n, R, wide) is at [r % TILE, :, :, r // TILE].
    """
    (H, W), (count, wide) = x.shape[2:], out.shape[3:]
    start, stop = min(max(left, 0), wide), min(max(left + W, 0), wide)
    for phase, target in enumerate(out):
        first = min(max(-(-(top - phase) // TILE), 0), count)
        end = min(max(-(-(top + H - phase) // TILE), first), count)
        target[:, :, :first] = target[:, :, end:] = 0
        inner = target[:, :, first:end]
        inner[..., :start] = inner[..., stop:] = 0
        row = TILE * first + phase - top
        last = row + TILE * (end - first)
        inner[..., start:stop] = x[:, :, row:last:TILE, start - left : stop - left]


def _correlate(weights: Array, V: Array, x: Array, after: After, y: Array) -> None:
    """Write the rows y (n, O, rows, Wo) of one block of images x."""
    (n, O, _, Wo), (R, T) = y.shape, _tiles(y)
    products = scratch("products", (SIDE * SIDE, O, n * R * T), y.dtype)
    np.matmul(weights, V, out=products)
    halves = scratch("mixed", (TILE, SIDE, O * n * R * T), y.dtype)
    transform(output_matrix(KERNEL), products.reshape(SIDE, -1), halves)
    merged = scratch("split", (TILE, O * n * R * T, TILE), y.dtype)
    np.matmul(halves.swapaxes(1, 2), output_matrix(KERNEL).T.astype(y.dtype), out=merged)
    check_spread(merged, x, O)
    by_channel = y.swapaxes(0, 1)
    for row, values in enumerate(merged.reshape(TILE, O, n, R, -1)):
        target = by_channel[:, :, row::TILE]
        after.write(values[:, :, : target.shape[2], :Wo], target, slice(0, O))


def _outputs(dy: Array) -> Array:
    """A dy Aᵀ of the tiles of dy (n, O, rows, Wo), Z (36, O, tiles)."""
    (n, O), (R, T) = dy.shape[:2], _tiles(dy)
    padded = scratch("padded", (TILE, O, n, R, TILE * T), dy.dtype)
    _place(dy.swapaxes(0, 1), 0, 0, padded)
    mixed = scratch("mixed", (TILE, SIDE, O * n * R * T), dy.dtype)
    tiles = padded.reshape(TILE, -1, TILE)
    np.matmul(output_matrix(KERNEL).T.astype(dy.dtype), tiles.swapaxes(1, 2), out=mixed)
    Z = scratch("products", (SIDE, SIDE * O * n * R * T), dy.dtype)
    transform(output_matrix(KERNEL).T, mixed, Z)
    return Z.reshape(SIDE * SIDE, O, -1)


def _tiles(y: Array) -> tuple[int, int]:
    """The rows of tiles of an image, and the tiles of a row."""
    return divide_up(y.shape[2], TILE), divide_up(y.shape[3], TILE)


def _blocks(x: Array, y: Array) -> Iterator[Block]:
    """The images and rows of tiles of each block; at least one for each thread
    outside of slices.
    """
    tiles = _tiles(y)
    bytes_each = SIDE * SIDE * (x.shape[1] + y.shape[1]) * x.itemsize
    each = max(BLOCK_BYTES // bytes_each, MIN_TILES)
    if not parallel.is_inside():
        part = divide_up(len(x) * math.prod(tiles), parallel.threads())
        each = min(each, max(part, MIN_PART))
    return image_blocks(len(x), tiles, each)
