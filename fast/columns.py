r"""Columns: convolution of any shape by products of the weights with columns, for several
images at a time.

As in the plain layer (layers/vision/convolution.py), each column holds the values of x under one
window. Here a block has the columns of several images, or of some rows of a large image:

    columns (C kh kw, n, Ho, Wo)        y (O, n Ho Wo)  =  w (O, C kh kw) @ columns
                                                           (C kh kw, n Ho Wo)

They are written to one buffer of the thread, which stays in the cache, and the products of
small images are as long as those of large ones. The gradient of the weights is one product
per block, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from operator import mul
from typing import Any

import numpy as np

from fast.fusing import After
from fast.geometry import (
    MAX_EXCESS,
    Algorithm,
    Geometry,
    Sizes,
    Sum,
    image_blocks,
    run_blocks,
    run_parts,
)
from fast.parallel import scratch
from netlib.blob import Array, divide_up

# Size of a block: smaller ones take more calls, larger ones do not stay in the cache.
COLUMN_BYTES = 8 << 20
MIN_COLUMNS = 512  # of a block, because BLAS copies the weights for every product
# Windows per output from which flipping the kernel takes less time than adding columns.
MIN_WINDOWS = 8
# Positions of an image from which a 1 x 1 convolution reads x in place, without joining images.
MIN_IMAGE = 128
MIN_ROW = 16  # outputs; copying shorter rows takes as long if their values are not adjacent
COPY_COST = 16  # multiplications that take as long as copying a value
FEW_COLUMNS = 32  # products of fewer columns take as long, because reading the weights limits them

Index = tuple[Any, ...]


class Columns(Algorithm):
    """The algorithm for all shapes: any number of spatial axes, stride, padding,
    dilation and groups.
    """

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """All sizes, except where flipping the kernel takes less time than adding instead of
        copying columns.
        """
        if sum_ != "transpose" or max(s.geometry.kernel) == 1:
            return True
        turned = s.turned
        if turned is None or turned.excess > MAX_EXCESS:
            return True
        windows = s.images * math.prod(s.windows)
        return s.inputs < s.outputs or windows < MIN_WINDOWS * s.outputs * s.geometry.group

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""

        def job(images: slice, rows: slice) -> None:
            columns = lower(g, x[images], rows, y.shape[2:])
            _correlate(g, w, after, columns, y[images, :, rows])

        run_blocks(job, _blocks(g, x, y.shape), w[0].size * y.size)

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx."""
        for images, rows in _blocks(g, dx, dy.shape):
            gradient = _by_channel(dy[images, :, rows])
            if _in_place(g, images):
                part = dx[images, :, rows]
                _transpose_in_place(g, w, after, gradient, part.reshape(part.shape[1], -1))
            else:
                _transpose(g, w, after, gradient, dx[images], rows, dy.shape[2:])

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        for images, rows in _blocks(g, x, dy.shape):
            columns = lower(g, x[images], rows, dy.shape[2:])
            _gradient(g, columns, _by_channel(dy[images, :, rows]), dw)

    def correlate_and_gradient(
        self, g: Geometry, x: Array, w: Array, dy: Array, y: Array, dw: Array
    ) -> None:
        """Write y and add to dw, from the same columns."""
        for images, rows in _blocks(g, x, y.shape):
            columns = lower(g, x[images], rows, y.shape[2:])
            _gradient(g, columns, _by_channel(dy[images, :, rows]), dw)
            _correlate(g, w, After(), columns, y[images, :, rows])


def _correlate(g: Geometry, w: Array, after: After, columns: Array, y: Array) -> None:
    """Write y (n, O, ...) of one block."""
    n, O = y.shape[:2]
    target = y.reshape(n, O, -1)
    result = target[0] if n == 1 else scratch("result", (O, columns.shape[1]), y.dtype)
    by_image = result.reshape(O, n, -1).swapaxes(0, 1)

    def job(o: slice) -> None:
        multiply(g, w, columns, result, o)
        after.write(by_image[:, o], target[:, o], o, axis=1)

    run_parts(job, O, g.group, w.size * max(columns.shape[1], FEW_COLUMNS))


def _transpose(
    g: Geometry, w: Array, after: After, dy: Array, dx: Array, rows: slice, outputs: tuple[int, ...]
) -> None:
    """Add the products of one block to the padded dx (n, C, ...), and write dx with
    its last rows.
    """
    n, C, *sizes = dx.shape
    elements = math.prod(g.kernel)
    columns = scratch("columns", (C * elements, dy.shape[1]), dx.dtype)
    windows = columns.reshape(C, *g.kernel, n, rows.stop - rows.start, *outputs[1:])
    padded = scratch("padded", (C, n, *g.padded(sizes)), dx.dtype)
    target = dx.swapaxes(0, 1)

    def job(c: slice) -> None:
        multiply_transposed(g, w, dy, columns, slice(c.start * elements, c.stop * elements))
        if rows.start == 0:
            padded[c] = 0
        for element, part in g.under_elements(rows, outputs):
            place = (c, slice(None)) + part
            padded[place] += windows[(c,) + element]
        if rows.stop == outputs[0]:
            inside = (c, slice(None)) + g.unpadded(sizes)
            after.write(padded[inside], target[c], c)

    run_parts(job, C, g.group, w.size * dy.shape[1] + columns.size * COPY_COST)


def _transpose_in_place(g: Geometry, w: Array, after: After, dy: Array, dx: Array) -> None:
    """Write dx (C, L) of one block of a 1 x 1 convolution."""

    def job(c: slice) -> None:
        multiply_transposed(g, w, dy, dx, c)
        after.write(dx[c], dx[c], c)

    run_parts(job, len(dx), g.group, w.size * dy.shape[1])


def _gradient(g: Geometry, columns: Array, dy: Array, dw: Array) -> None:
    """Add the product of one block to dw."""
    O, L = dy.shape

    def job(o: slice) -> None:
        each, group = _groups(g, O, o)
        factor = columns.reshape(g.group, -1, L)[group].swapaxes(1, 2)
        dw[o] += (dy[o].reshape(-1, each, L) @ factor).reshape(dw[o].shape)

    run_parts(job, O, g.group, dw.size * L)


def _in_place(g: Geometry, images: slice) -> bool:
    """Whether the columns of these images are a view of x."""
    return g.is_pointwise and set(g.stride) == {1} and images.stop - images.start == 1


def lower(g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...]) -> Array:
    """Copy x (n, C, ...) to columns (C kh kw, n L), for these rows of outputs; a view if they
    are a part of x.
    """
    n, C = x.shape[:2]
    if _in_place(g, slice(0, n)):
        return x[0, :, rows].reshape(C, -1)
    by_channel = x.swapaxes(0, 1)
    lowering = _lowering(
        g, x.shape[2:], by_channel.strides, x.dtype, n, rows.start, rows.stop, outputs
    )
    by_channel = by_channel[:, :, lowering.rows]
    columns = scratch("columns", (C, *g.kernel, n, rows.stop - rows.start, *outputs[1:]), x.dtype)
    padded = scratch("padded", (C, n, *lowering.padded), x.dtype) if lowering.padded else by_channel

    def job(c: slice) -> None:
        source, target, read = by_channel[c], columns[c], padded[c]
        if lowering.padded:
            read.fill(0)
            for place, values in lowering.copies:
                read[place] = source[values]
        # few calls, because small copies take less time than calls
        for own, start, strides in lowering.windows:
            part = target[own]
            if lowering.padded:  # as_strided takes ten times as long
                part[...] = np.ndarray(part.shape, part.dtype, read, start, strides)
            else:
                part[...] = np.lib.stride_tricks.as_strided(read, part.shape, strides)

    run_parts(job, C, 1, columns.size * COPY_COST)
    return columns.reshape(C * math.prod(g.kernel), -1)


@dataclass(frozen=True)
class _Lowering:
    """What is copied for some rows of outputs; all indices are without the channels.

    rows      those of x under them
    padded    the spatial axes with padding, the last one split into every stride-th value; None if
              x is read in place
    copies    indices of the padded values and of x
    windows   for the elements of the kernel that read the same of these values in each row, the
              index of their columns, and the first byte and the strides of the values under them
    """

    rows: slice
    padded: tuple[int, ...] | None
    copies: list[tuple[Index, Index]]
    windows: list[tuple[Index, int, tuple[int, ...]]]


@lru_cache(maxsize=256)
def _lowering(
    g: Geometry,
    sizes: tuple[int, ...],
    strides: tuple[int, ...],
    dtype: Any,
    n: int,
    start: int,
    stop: int,
    outputs: tuple[int, ...],
) -> _Lowering:
    """What is copied for the rows ``start`` to ``stop`` of outputs; ``strides`` are those of
    x (C, n, ...).
    """
    begin = start * g.stride[0] - g.pad[0]
    end = begin + g.extent([stop - start])[0]
    low = min(max(begin, 0), sizes[0])
    high = max(min(end, sizes[0]), 0)
    inside = (slice(low - begin, max(high, low) - begin), *g.unpadded(sizes)[1:])
    last = g.stride[-1]
    # With this step, the values of a column are adjacent.
    step = last if g.kernel[-1] > last and outputs[-1] >= MIN_ROW else 1
    if step == 1 and not any(g.pad):
        return _Lowering(slice(low, high), None, [], _windows(g, 1, 0, strides))
    *height, width = (end - begin, *g.padded(sizes)[1:])
    padded = (*height, step, divide_up(width, step))
    *others, phase_bytes, next_bytes = np.empty((1, n, *padded), dtype).strides
    windows = _windows(g, step, phase_bytes, (*others, next_bytes))
    return _Lowering(slice(low, high), padded, _copies(inside, step), windows)


def _copies(inside: tuple[slice, ...], step: int) -> list[tuple[Index, Index]]:
    """Indices of the padded values and of x, for each remainder modulo ``step`` of the column."""
    copies: list[tuple[Index, Index]] = []
    left, right = inside[-1].start, inside[-1].stop
    for phase in range(step):
        values = slice((phase - left) % step, right - left, step)
        place = (left + values.start) // step
        places = slice(place, place + len(range(values.start, values.stop, step)))
        copies.append(((slice(None), slice(None), *inside[:-1], phase, places), (..., values)))
    return copies


def _windows(
    g: Geometry, step: int, phase_bytes: int, strides: tuple[int, ...]
) -> list[tuple[Index, int, tuple[int, ...]]]:
    """The windows of a _Lowering; ``strides`` are those of the values that are read."""
    # Elements of a row that are one period apart read the same of every ``step`` values.
    period = step // math.gcd(step, g.dilation[-1])
    next_value = g.dilation[-1] * period // step
    down = map(mul, (*g.dilation[:-1], next_value), strides[2:])
    across = map(mul, (*g.stride[:-1], g.stride[-1] // step), strides[2:])
    window_strides = strides[0], *down, strides[1], *across
    other_axes = (slice(None),) * len(g.kernel)
    windows: list[tuple[Index, int, tuple[int, ...]]] = []
    for first in range(min(period, g.kernel[-1])):
        place, phase = divmod(first * g.dilation[-1], step)
        first_byte = phase * phase_bytes + place * strides[-1]
        windows.append(((*other_axes, slice(first, None, period)), first_byte, window_strides))
    return windows


def multiply(g: Geometry, w: Array, columns: Array, out: Array, o: slice) -> None:
    """Write the rows ``o`` of w @ columns to out (O, L), group by group."""
    rows, group = _groups(g, len(w), o)
    L = columns.shape[1]
    weights = w[o].reshape(-1, rows, w[0].size)
    right = columns.reshape(g.group, -1, L)[group]
    np.matmul(weights, right, out=out[o].reshape(-1, rows, L))


def multiply_transposed(g: Geometry, w: Array, dy: Array, out: Array, k: slice) -> None:
    """Write the rows ``k`` of wᵀ @ dy to out (C kh kw, L), group by group."""
    rows, group = _groups(g, len(out), k)
    L = dy.shape[1]
    weights = w.reshape(g.group, len(w) // g.group, -1)[group]
    if g.group == 1:
        weights = weights[:, :, k]
    right = dy.reshape(g.group, -1, L)[group]
    np.matmul(weights.swapaxes(1, 2), right, out=out[k].reshape(-1, rows, L))


def _groups(g: Geometry, count: int, part: slice) -> tuple[int, slice]:
    """Rows of each group in a part of ``count`` rows, and the groups of the part."""
    each = count // g.group
    if g.group == 1:
        return part.stop - part.start, slice(0, 1)
    return each, slice(part.start // each, part.stop // each)


def _blocks(g: Geometry, x: Array, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """The images and rows of outputs of each block."""
    column_bytes = x.shape[1] * math.prod(g.kernel) * x.itemsize
    columns = max(COLUMN_BYTES // column_bytes, MIN_COLUMNS)
    outputs = math.prod(y_shape[2:])
    if g.is_pointwise and outputs >= MIN_IMAGE:
        columns = min(columns, outputs)
    return image_blocks(len(x), y_shape[2:], columns)


def _by_channel(dy: Array) -> Array:
    """Dy (n, O, ...) as (O, n L): a view of one image, else a copy."""
    n, O = dy.shape[:2]
    rows = dy.reshape(n, O, -1)
    if n == 1:
        return rows[0]
    copy = scratch("dy", (O, n, rows.shape[2]), dy.dtype)
    copy[...] = rows.swapaxes(0, 1)
    return copy.reshape(O, -1)
