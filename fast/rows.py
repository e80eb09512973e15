r"""Rows: convolution by one product per row of outputs, or per plane of a volume, with less
copying than im2col.

Im2col copies each value of x kh * kw times. Here it is copied only kw times, to
X[h, j, c, n, w] = x[n, c, h, w + j]. The kh rows of X for a row of outputs are contiguous, so all
right factors are one strided view of X:

    Y[h] (O, n Wo)  =  w (O, kh kw C) @ X[h : h + kh] (kh kw C, n Wo)

With a stride, X has every second column, for example, and Y[h] starts at every second row. The
gradient of x, with stride 1, is a convolution of dy with the flipped kernel, the gradient of w the
sum of dY[h] Xᵀ over the rows. For volumes, h is the first axis, and w and j are all others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from fast.fusing import After
from fast.geometry import (
    MAX_EXCESS,
    Algorithm,
    Geometry,
    Sizes,
    Sum,
    places_inside,
    run_blocks,
    run_parts,
)
from fast.parallel import equal_blocks, scratch
from netlib.blob import Array, divide_up

LENGTH = 128  # columns of a product, of several images if their rows are shorter
BLOCK_BYTES = 1 << 20  # of X
MIN_ROWS = 8  # of outputs in a block, which reads kh - 1 more rows
FEW_WEIGHTS = 60_000
COPY = 16  # multiplications that take as long as copying a value

Index = tuple[Any, ...]


class Rows(Algorithm):
    """The algorithm for images and volumes without groups, without dilation of the first axis,
    and few outputs.
    """

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Few outputs, so that copying takes as long as the product, and long rows: up to twice as
        fast. For dw also few weights, because there is a product for each row of outputs: up to 1.4
        times as fast.
        """
        g = s.geometry
        if sum_ == "transpose" or s.excess > MAX_EXCESS:
            return False
        if len(s.sizes) < 2 or g.dilation[0] > 1 or g.group > 1:
            return False
        overlap = all(k > step for k, step in zip(g.kernel, g.stride))
        if not overlap or not 8 <= s.outputs <= 96:
            return False
        has_few_weights = s.inputs * math.prod(g.kernel) * s.outputs <= FEW_WEIGHTS
        is_long = s.images * math.prod(s.windows[1:]) >= (16 if has_few_weights else 64)
        return is_long and (has_few_weights or sum_ != "gradient")

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        weights = w.transpose(0, *range(2, w.ndim), 1).reshape(len(w), -1)

        def job(images: slice, rows: slice) -> None:
            X = stacked(g, x[images], rows, y.shape[3:])
            _correlate(weights, X, after, y[images, :, rows])

        run_blocks(job, _blocks(g, x, y.shape), weights.size * y.size // len(w))

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        O, C, *kernel = dw.shape
        total = np.zeros((*kernel, C, O), dw.dtype)
        for images, rows in _blocks(g, x, dy.shape):
            X = stacked(g, x[images], rows, dy.shape[3:])
            _gradient(X, dy[images, :, rows], total.reshape(-1, O))
        dw += total.transpose(-1, -2, *range(len(kernel)))


def _correlate(weights: Array, X: Array, after: After, y: Array) -> None:
    """Write the rows y (n, O, rows, ...) of one block."""
    y = y.reshape(*y.shape[:3], -1)
    n, O, R, Wo = y.shape
    out = scratch("result", (R, O, n * Wo), y.dtype)
    by_row = out.reshape(R, O, n, Wo).transpose(2, 1, 0, 3)

    def job(o: slice) -> None:
        np.matmul(weights[o], X, out=out[:, o])
        after.write(by_row[:, o], y[:, o], o, axis=1)

    run_parts(job, O, 1, weights.size * n * R * Wo)


def _gradient(X: Array, dy: Array, total: Array) -> None:
    """Add the products of one block to total (kh kw C, O)."""
    dy = dy.reshape(*dy.shape[:3], -1)
    n, O, R, Wo = dy.shape
    gradient = scratch("dy", (R, O, n, Wo), dy.dtype)
    gradient[...] = dy.transpose(2, 1, 0, 3)
    products = scratch("result", (R, *total.shape), dy.dtype)
    right = gradient.reshape(R, O, -1).swapaxes(1, 2)

    def job(o: slice) -> None:
        np.matmul(X, right[:, :, o], out=products[:, :, o])
        total[:, o] += products[:, :, o].sum(axis=0)

    run_parts(job, O, 1, total.size * n * R * Wo)


def stacked(g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...]) -> Array:
    """X of x (n, C, H, ...) for these rows of outputs, as the view (rows, kernel C, n L) with L
    ``outputs`` each.
    """
    n, C, H = x.shape[:3]
    R = rows.stop - rows.start
    down = g.stride[0]
    elements = math.prod(g.kernel[1:])
    height = (R - 1) * down + g.kernel[0]
    X = scratch("columns", (height, elements, C, n, *outputs), x.dtype)
    start = rows.start * down - g.pad[0]  # the row of x at the first of X, negative in the padding
    low, high = max(start, 0), max(min(start + height, H), 0)  # the rows of x that X has
    above, below = min(low - start, height), max(high - start, 0)  # where they are in X
    copies = _copies(g, x.shape[3:], outputs)

    def job(c: slice) -> None:
        X[:above, :, c] = X[below:, :, c] = 0
        source, target = x[:, c, low:high].swapaxes(0, 2), X[above:below, :, c]
        for own, taken, edges in copies:
            for edge in edges:
                target[edge] = 0
            target[own] = source[taken]

    run_parts(job, C, 1, X.size * COPY)
    length = n * math.prod(outputs)
    row_bytes = elements * C * length * X.itemsize
    shape = (R, g.kernel[0] * elements * C, length)
    strides = (down * row_bytes, length * X.itemsize, X.itemsize)
    return np.ndarray(shape, X.dtype, X, 0, strides)


@lru_cache(maxsize=256)
def _copies(
    g: Geometry, sizes: tuple[int, ...], outputs: tuple[int, ...]
) -> list[tuple[Index, Index, list[Index]]]:
    """For each element of the kernel without the first axis, the indices in X of the windows in
    which it is inside x, those of its values there, and the indices of the other windows.
    """
    copies: list[tuple[Index, Index, list[Index]]] = []
    for element, place in enumerate(np.ndindex(g.kernel[1:])):
        own: Index = (slice(None), element, ...)
        taken: Index = (...,)
        edges: list[Index] = []
        axes = zip(place, g.dilation[1:], g.pad[1:], g.stride[1:], sizes, outputs)
        for i, d, p, step, size, count in axes:
            first, within = places_inside(i * d - p, step, size, count)
            others = [slice(0, within.start), slice(within.stop, count)]
            rest = (slice(None),) * (len(outputs) - len(taken))
            edges += [(*own, edge, *rest) for edge in others if edge.stop > edge.start]
            own += (within,)
            taken += (slice(first, first + (within.stop - within.start) * step, step),)
        copies.append((own, taken, edges))
    return copies


def _blocks(g: Geometry, x: Array, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """The images and rows of outputs of each block: long products, and as many rows as
    fit in the cache.
    """
    (N, C), Ho, row = x.shape[:2], y_shape[2], math.prod(y_shape[3:])
    row_bytes = math.prod(g.kernel[1:]) * C * row * x.itemsize  # of X, for one image
    each = divide_up(LENGTH, row)  # images
    for images in equal_blocks(N, divide_up(N, each)):
        height = BLOCK_BYTES // (row_bytes * (images.stop - images.start))  # of X
        fitting = (height - g.kernel[0]) // g.stride[0] + 1
        for rows in equal_blocks(Ho, divide_up(Ho, max(fitting, MIN_ROWS))):
            yield images, rows
