r"""RowWinograd: 3 x 3 and 5 x 5 convolutions of several images with 50 to 40% of the
multiplications.

Winograd's minimal filtering along the rows only: m = 4 neighbouring outputs of a row are computed
from P = k + 3 inputs d with P instead of 4 k products. Compared with tiles of both axes
(winograd.py) there are more products, but 1.5 to 2 instead of 2.25 to 9 transformed values for each
value of x, so it is faster with few channels.

    y = Aᵀ [sum over rows of the kernel of (G w) * (Bᵀ d)]

The points are 0, the pairs a, -a below, and infinity. With q(z) = product of (z - b²) over the
other pairs b:

    Bᵀ d at 0         sum of q[i] d[2i],  q over all pairs
         at a, -a     e ± a o  with e = sum of q[i] d[2i + 2], o = sum of q[i] d[2i + 1]
         at infinity  sum of q[i] d[2i + 1],  q over all pairs
    Aᵀ at a point p   1  p  p²  p³
       at infinity    0  0  0   1
    G  at a point p   (1  p  p² ...) / product of (p - other points)

The image is the last axis, so that a tile is some whole vectors, and the rows of a
window are adjacent:

    V (P, H, C, T, n)    transformed tiles of the padded rows
    Y[p, h] (O, T n)   =  w[p] (O, k C) @ V[p, h : h + k] (k C, T n)
    dw[p] (k C, O)     =  sum over h of V[p, h : h + k] (k C, T n) @ Z[p, h] (T n, O)
                          with Z = A dy
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from fast import parallel
from fast.fusing import After
from fast.geometry import Algorithm, Geometry, Sizes, Sum, check_finite, check_spread
from fast.last_axis import map_first, map_last
from fast.parallel import equal_blocks, scratch
from netlib.blob import Array, divide_up

TILE = 4  # outputs
# with a small largest error, below 5e-6 of the largest output
PAIRS = {3: (0.75, 1.5), 5: (0.6, 1.0, 1.0 / 0.6)}
BLOCK_BYTES = 2 << 20  # of V; smaller blocks take more calls
MIN_IMAGES = 8  # of a block, so that copied vectors are long
MAX_ROW_EXCESS = 2.5  # of multiplications for dx


class RowWinograd(Algorithm):
    """The algorithm for 3 x 3 and 5 x 5 kernels, stride 1, without dilation and groups, and
    several images.
    """

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """5 x 5, or 3 x 3 with fewer channels and smaller maps than Winograd, and enough channels
        to make the time of the transforms small. Up to twice as fast as the next.

        For dw with fewer channels, because dy has no values to be added.
        """
        if (
            sum_ == "transpose"
            or s.geometry.kernel not in ((3, 3), (5, 5))
            or not s.geometry.is_dense
        ):
            return False
        if s.geometry.group > 1 or s.excess > MAX_ROW_EXCESS:
            return False
        area = s.inputs * math.prod(s.sizes)
        channels, total = s.inputs * s.outputs, s.inputs + s.outputs
        if s.geometry.kernel == (5, 5):
            return channels >= (2 if sum_ == "gradient" else 6) * total and s.images * area >= 4096
        return channels >= 16 * total and total <= 192 and s.images >= 8 and area <= 1 << 16

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        (O, C), k = w.shape[:2], g.kernel[0]
        by_column = w.transpose(3, 0, 2, 1).reshape(k, -1)
        weights = (kernel_matrix(k).astype(w.dtype) @ by_column).reshape(k + 3, 1, O, k * C)

        def job(images: slice) -> None:
            _correlate(weights, _inputs(g, x[images], y.shape[2:]), x[images], after, y[images])

        parallel.run([partial(job, images) for images in _blocks(k, x, y)])

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        (O, C), k = dw.shape[:2], g.kernel[0]
        parts = _blocks(k, x, dy)
        totals = scratch("totals", (len(parts), k + 3, k * C, O), dw.dtype)

        def job(number: int, images: slice) -> None:
            V, Z = _inputs(g, x[images], dy.shape[2:]), _outputs(k, dy[images])
            products = scratch("result", (len(Z[0]), k * C, O), dw.dtype)
            for left, right, total in zip(_windows(k, V), Z, totals[number]):
                np.matmul(left, right, out=products).sum(axis=0, out=total)

        parallel.run([partial(job, number, images) for number, images in enumerate(parts)])
        total = totals.sum(axis=0).reshape(k + 3, -1)
        found = kernel_matrix(k).T.astype(dw.dtype) @ total
        check_finite(found)
        dw += found.reshape(k, k, C, O).transpose(3, 2, 1, 0)


def _points(k: int) -> list[float]:
    """The points except infinity."""
    return [0.0, *(sign * p for p in PAIRS[k] for sign in (1, -1))]


@lru_cache
def kernel_matrix(k: int) -> Array:
    """The matrix G (k + 3, k)."""
    points = _points(k)
    matrix = np.zeros((k + 3, k))
    for p, row in zip(points, matrix):
        scale = math.prod(p - q for q in points if q != p)
        row[:] = [p**j / scale for j in range(k)]
    matrix[-1, -1] = 1
    return matrix


def _factors(k: int, without: float = 0.0) -> Array:
    """The coefficients, lowest first, of the product of (z - p²) over the pairs p of a
    kernel except one.
    """
    return np.poly([p * p for p in PAIRS[k] if p != without])[::-1]


@lru_cache
def input_matrix(k: int) -> Array:
    """The matrix Bᵀ (k + 3, k + 3)."""
    matrix = np.zeros((k + 3, k + 3))
    matrix[0, 0::2] = matrix[-1, 1::2] = _factors(k)
    for i, p in enumerate(PAIRS[k]):
        for row, point in zip(matrix[2 * i + 1 :], (p, -p)):
            row[2::2] = _factors(k, p)
            row[1:-1:2] = point * row[2::2]
    return matrix


@lru_cache
def output_matrix(k: int) -> Array:
    """The matrix Aᵀ (TILE, k + 3)."""
    matrix = np.zeros((TILE, k + 3))
    for i, row in enumerate(matrix):
        row[:-1] = [p**i for p in _points(k)]
    matrix[-1, -1] = 1
    return matrix


def transform(matrix: Array, vectors: Array, out: Array) -> None:
    """Write matrix @ vectors, arrays (vectors, ...), in one call: threads wait for each other
    between calls.
    """
    right = vectors.reshape(len(vectors), -1)
    np.matmul(matrix.astype(out.dtype), right, out=out.reshape(len(out), -1))


def as_units(values: Array) -> Array:
    """View each vector along the last axis as one item, because NumPy copies an item faster
    than its values.
    """
    return values.view(np.dtype((np.void, values.shape[-1] * values.itemsize)))[..., 0]


def _by_column(columns: Array, left: int, out: Array) -> None:
    """Copy columns (H, W, ...) to out (count, H, T, ...): column TILE t + i - left to [i, :, t],
    with zeros around.
    """
    tiles, zero = out.shape[2], np.zeros((), out.dtype)
    for phase, target in enumerate(out):
        first = max(-(-(left - phase) // TILE), 0)
        source = columns[:, TILE * first + phase - left :: TILE]
        end = min(first + source.shape[1], tiles)
        target[:, :first] = target[:, end:] = zero
        target[:, first:end] = source[:, : end - first]


def _inputs(g: Geometry, x: Array, outputs: tuple[int, ...]) -> Array:
    """V (P, H, C, T, n) of x (n, C, H, W)."""
    (n, C, H, W), k, (top, left) = x.shape, g.kernel[0], g.pad
    T = divide_up(outputs[1], TILE)
    flat = scratch("by place", (C, H, W, n), x.dtype)
    map_last(x.reshape(n, C * H, W), flat.reshape(C * H, W, n))
    split = scratch("split", (k + 3, outputs[0] + k - 1, C, T, n), x.dtype)
    split[:, :top] = split[:, top + H :] = 0
    inside = as_units(split)[:, top : top + H]
    _by_column(as_units(flat).transpose(1, 2, 0), left, inside.swapaxes(2, 3))
    V = scratch("inputs", split.shape, x.dtype)
    transform(input_matrix(k), split, V)
    return V


def _windows(k: int, V: Array) -> Array:
    """View V as the factors (P, Ho, k C, T n)."""
    P, H, C, T, n = V.shape
    point, row, channel, _, item = V.strides
    shape = P, H - k + 1, k * C, T * n
    return np.lib.stride_tricks.as_strided(V, shape, (point, row, channel, item))


def _correlate(weights: Array, V: Array, x: Array, after: After, y: Array) -> None:
    """Write y (n, O, Ho, Wo) of images x."""
    (n, O, Ho, Wo), T, k = y.shape, V.shape[3], len(V) - 3
    products = scratch("products", (k + 3, Ho, O, T * n), y.dtype)
    np.matmul(weights, _windows(k, V), out=products)
    sums = scratch("split", (TILE, Ho, O, T, n), y.dtype)
    transform(output_matrix(k), products, sums)
    check_spread(sums, x, O)
    rows = sums.reshape(TILE * Ho, O, T * n)
    after.write(rows, rows, slice(0, O), axis=1)
    flat = scratch("by place", (O, Ho, Wo, n), y.dtype)
    for phase, values in enumerate(as_units(sums)):
        target = as_units(flat)[:, :, phase::TILE]
        target[...] = values.swapaxes(0, 1)[:, :, : target.shape[2]]
    map_first(flat.reshape(-1, n), y)


def _outputs(k: int, dy: Array) -> Array:
    """Z (P, Ho, T n, O) of dy (n, O, Ho, Wo)."""
    n, O, Ho, Wo = dy.shape
    T = divide_up(Wo, TILE)
    flat = scratch("by place", (Ho, Wo, n * O), dy.dtype)
    map_last(dy.reshape(n * O, Ho, Wo), flat)
    split = scratch("split", (TILE, Ho, T, n * O), dy.dtype)
    _by_column(as_units(flat), 0, as_units(split))
    Z = scratch("products", (k + 3, Ho, T * n, O), dy.dtype)
    transform(output_matrix(k).T, split, Z)
    return Z


def _blocks(k: int, x: Array, y: Array) -> list[slice]:
    """The images of each block; at least one block for each thread outside of slices."""
    N, C, (O, Ho, Wo) = len(x), x.shape[1], y.shape[1:]
    T = divide_up(Wo, TILE)
    bytes_each = (k + 3) * T * max((Ho + k - 1) * C, Ho * O) * x.itemsize
    each = max(BLOCK_BYTES // bytes_each, MIN_IMAGES)
    if not parallel.is_inside():
        each = min(each, divide_up(N, parallel.threads()))
    return equal_blocks(N, divide_up(N, max(each, 1)))
