"""FastConvolution and FastDeconvolution: each chooses algorithms for the shapes of its blobs.

For each of the sums y, dx and dw (geometry.py), the first algorithm in ALGORITHMS that fits the
sizes is used. The conditions are those under which it is the fastest, as measured alone with one
thread. Convolutions without padding next to poolings may be computed on tiles instead
(row_tiles.py, window_tiles.py), and without a spatial axis by the plain layer.

A deconvolution is the transpose of a convolution from its top to its bottom and uses the same
algorithms, except tiles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fast.columns import Columns
from fast.depthwise import Depthwise, Filter
from fast.fast_layer import FastLayer
from fast.fusing import After, after_of
from fast.geometry import Algorithm, Geometry, NotFiniteError, Sizes, Sum, check_finite
from fast.row_tiles import RowTiles
from fast.row_winograd import RowWinograd
from fast.rows import Rows
from fast.tiles import FastBlob, pitch_of, plain_of, store_plain
from fast.window_tiles import WindowTiles
from fast.winograd import Winograd
from layers.vision.convolution import Convolution
from layers.vision.deconvolution import Deconvolution
from layers.vision.depthwise_convolution import ConvolutionDepthwise, DepthwiseConvolution
from netlib.blob import Array, Blob, Blobs, blocks, divide_up


class ByGroup(Algorithm):
    """Runs an algorithm for one group on each group."""

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether the algorithm fits one group."""
        return self.algorithm.fits(s.one_group, sum_)

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        for i, o in _channels(g, x, y):
            self.algorithm.correlate(g.one_group, x[:, i], w[o], after.part(o), y[:, o])

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        for i, o in _channels(g, x, dy):
            self.algorithm.gradient(g.one_group, x[:, i], dy[:, o], dw[o])


def _channels(g: Geometry, x: Array, y: Array) -> Iterator[tuple[slice, slice]]:
    """The channels of x and of y of each group."""
    inputs = blocks(x.shape[1], x.shape[1] // g.group)
    outputs = blocks(y.shape[1], y.shape[1] // g.group)
    return zip(inputs, outputs)


class Turned(Algorithm):
    """Computes dx as the convolution of dy with the flipped kernel."""

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether there is such a convolution, and the algorithm fits it."""
        return (
            sum_ == "transpose"
            and s.turned is not None
            and self.algorithm.fits(s.turned, "correlate")
        )

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx.

        An infinite weight times the padding of dy is NaN where no window has that weight.
        """
        try:
            check_finite(w)
        except NotFiniteError:
            Columns().transpose(g, dy, w, after, dx)
        else:
            self.algorithm.correlate(g.turned, dy, g.flipped(w), after, dx)


class Contained(Algorithm):
    """Keeps an infinite value or NaN in its windows: runs an algorithm that mixes the values of
    several windows and, where it finds such a value, which may also be an overflow in a
    transform, Columns.
    """

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether the algorithm fits."""
        return self.algorithm.fits(s, sum_)

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        try:
            self.algorithm.correlate(g, x, w, after, y)
        except NotFiniteError:
            Columns().correlate(g, x, w, after, y)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        try:
            self.algorithm.gradient(g, x, dy, dw)
        except NotFiniteError:
            Columns().gradient(g, x, dy, dw)


_DIRECT: tuple[Algorithm, ...] = (
    Contained(Filter()),
    Depthwise(),
    ByGroup(Contained(RowWinograd())),
    ByGroup(Contained(Winograd())),
    ByGroup(Rows()),
    Columns(),
)
ALGORITHMS: tuple[Algorithm, ...] = tuple(
    each for direct in _DIRECT for each in (direct, Turned(direct))
)


@dataclass(frozen=True)
class Choice:
    """The algorithm of each of the three sums."""

    for_y: Algorithm
    for_dx: Algorithm
    for_dw: Algorithm


def choose(g: Geometry, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Choice:
    """The fastest algorithms for x (N, C, ...) and y (N, O, ...), with at least
    one spatial axis.
    """
    s = Sizes.of(g, x_shape, y_shape)

    def first(sum_: Sum) -> Algorithm:
        return next(algorithm for algorithm in ALGORITHMS if algorithm.fits(s, sum_))

    return Choice(first("correlate"), first("transpose"), first("gradient"))


class ByAlgorithms(FastLayer, Convolution):
    """Base class.

    algorithms  the algorithms on arrays for each bottom; none for the plain layer
    """

    algorithms: Sequence[Choice] = ()

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the geometry."""
        super().setup(bottom, top)
        self.geometry = Geometry(
            self.kernel, self.stride, self.pad, self.dilation, self.param.group
        )

    def fuses_relu(self) -> bool:
        """Whether an algorithm computes what is behind the layer: not the plain layer."""
        return len(self.algorithms) > 0

    def fuses_channels(self) -> bool:
        """The same, if the outputs are the channels of the top."""
        return self.fuses_relu() and self.axis == 1


class FastConvolution(ByAlgorithms):
    """Convolution by the algorithm that is the fastest for its shapes.

    tiles  the algorithm on tiles, or None
    """

    tiles: RowTiles | WindowTiles | None = None

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Create the algorithms that keep matrices of the weights."""
        super().setup(bottom, top)
        self.row_tiles, self.window_tiles = RowTiles(), WindowTiles()

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The tile of the top, or a size for which the matrix product is fast; None if not
        computed on tiles.
        """
        return self.row_tiles.tile(top_tile, self.weight.shape) if self.tiles else None

    def writes_tiles(self) -> bool:
        """Whether RowTiles or WindowTiles computes the layer; they write tiles of any size."""
        return self.tiles is not None

    def writes_sparse(self) -> bool:
        """Whether the top can be sparse: True if the gradient of the bottom is not needed."""
        return self.tiles is not None and not self.needs_bottom_diff

    def fuses_relu(self) -> bool:
        """Whether the algorithm computes what is behind the layer: not on tiles."""
        return self.tiles is None and super().fuses_relu()

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and choose the algorithm."""
        super().reshape(bottom, top)
        for x, y in zip(bottom, top):
            if isinstance(y, FastBlob) and y.tile is not None:
                y.pitch = divide_up(pitch_of(x) or x.width, y.tile) * y.tile
        on_tiles = self.window_tiles, self.row_tiles
        self.tiles = next(
            (one for one in on_tiles if one.fits(self.geometry, bottom, top, self.weight)), None
        )
        self.algorithms = choose_each(self.geometry, self.axis, bottom, top)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        bias = self.bias.data if self.param.bias_term else None
        if self.tiles:
            for choice, x, y in zip(self.algorithms, bottom, top):
                try:
                    self.tiles.forward(self, x, y, self.weight.data, bias)
                except NotFiniteError:
                    self._forward_untiled(choice, x, y, bias)
        elif self.algorithms:
            w, after = self.weight.data, after_of(bias, self.after)
            if 2 * w.size < top[0].count:  # scaling the weights takes less time
                w, after = after.fold(w)
            for choice, x, y in zip(self.algorithms, bottom, top):
                choice.for_y.correlate(
                    self.geometry, self.images(x.data), w, after, self.images(y.data)
                )
        else:
            super().forward(bottom, top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        db = self.bias.diff if self.param.bias_term else None
        if self.tiles:
            for choice, x, y, down in zip(self.algorithms, bottom, top, propagate_down):
                try:
                    self.tiles.backward(self, x, y, self.weight.data, self.weight.diff, db, down)
                except NotFiniteError:
                    self._backward_untiled(choice, x, y, down)
        elif self.algorithms:
            for choice, x, y, down in zip(self.algorithms, bottom, top, propagate_down):
                self._backward(
                    choice,
                    self.images(x.data),
                    self.images(y.diff),
                    self.images(x.diff) if down else None,
                )
        else:
            super().backward(top, propagate_down, bottom)

    def _backward(self, choice: Choice, x: Array, dy: Array, dx: Array | None) -> None:
        """Add to the diffs of the parameters and write dx, if any, by the algorithms on arrays."""
        choice.for_dw.gradient(self.geometry, x, dy, self.weight.diff)
        if self.param.bias_term:
            self.bias.diff[...] += sum_by_channel(dy)
        if dx is not None:
            choice.for_dx.transpose(self.geometry, dy, self.weight.data, After(), dx)

    # On tiles, an infinite value or NaN would reach outputs whose windows do not contain it.

    def _forward_untiled(self, choice: Choice, x: Blob, y: Blob, bias: Array | None) -> None:
        """Compute a tiled y by the algorithm on arrays."""
        if isinstance(y, FastBlob):
            y.sparse = None
        out = np.empty(y.shape, y.dtype)
        choice.for_y.correlate(
            self.geometry, plain_of(x, x.data), self.weight.data, After(bias=bias), out
        )
        store_plain(y, out, y.data)

    def _backward_untiled(self, choice: Choice, x: Blob, y: Blob, down: bool) -> None:
        """Compute the gradients for tiled blobs by the algorithms on arrays."""
        dx = np.empty(x.shape, x.dtype) if down else None
        self._backward(choice, plain_of(x, x.data), plain_of(y, y.diff), dx)
        if dx is not None:
            store_plain(x, dx, x.diff)


class FastDepthwiseConvolution(FastConvolution, DepthwiseConvolution):
    """Convolution of each channel on its own."""


class FastConvolutionDepthwise(FastConvolution, ConvolutionDepthwise):
    """Convolution of each channel on its own, with as many outputs as channels."""


class FastDeconvolution(ByAlgorithms, Deconvolution):
    """Deconvolution by the algorithm that is the fastest for its shapes."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and choose the algorithm."""
        super().reshape(bottom, top)
        self.algorithms = choose_each(self.geometry, self.axis, top, bottom)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        if not self.algorithms:
            super().forward(bottom, top)
            return
        after = after_of(self.bias.data if self.param.bias_term else None, self.after)
        for choice, x, y in zip(self.algorithms, bottom, top):
            arrays = self.images(x.data), self.weight.data, after, self.images(y.data)
            choice.for_dx.transpose(self.geometry, *arrays)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        if not self.algorithms:
            super().backward(top, propagate_down, bottom)
            return
        for choice, x, y, down in zip(self.algorithms, bottom, top, propagate_down):
            dy = self.images(y.diff)
            if self.param.bias_term:
                self.bias.diff[...] += sum_by_channel(dy)
            if down and max(self.geometry.stride) > 1:  # one set of columns for both sums
                arrays = self.images(x.data), self.images(x.diff), self.weight.diff
                Columns().correlate_and_gradient(self.geometry, dy, self.weight.data, *arrays)
                continue
            choice.for_dw.gradient(self.geometry, dy, self.images(x.data), self.weight.diff)
            if down:
                choice.for_y.correlate(
                    self.geometry, dy, self.weight.data, After(), self.images(x.diff)
                )


def choose_each(g: Geometry, axis: int, xs: Blobs, ys: Blobs) -> list[Choice]:
    """The algorithms for each pair of blobs x and y with channels on this axis; none without
    a spatial axis.
    """

    def of_images(blob: Blob) -> tuple[int, ...]:
        return math.prod(blob.shape[:axis]), *blob.shape[axis:]

    if not g.kernel:
        return []
    return [choose(g, of_images(x), of_images(y)) for x, y in zip(xs, ys)]


def sum_by_channel(dy: Array) -> Array:
    """The sum (O,) of dy (N, O, ...) over images and positions."""
    total: Array = dy.sum(axis=tuple(range(2, dy.ndim))).sum(axis=0)
    return total
