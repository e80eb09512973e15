"""FastConvolution and FastDeconvolution: each chooses algorithms for the shapes of its blobs.

For each of the sums y, dx and dw (geometry.py), the first algorithm in ALGORITHMS that is the fastest for the sizes is
used. Its condition says for which sizes it is, as measured alone with one thread; geometry.py explains the sums.
Convolutions without padding next to poolings may be computed on tiles instead (row_tiles.py, window_tiles.py), and
without a spatial axis by the plain layer.

A deconvolution is the transpose of a convolution from its top to its bottom and uses the same algorithms, except tiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from fast.columns import Columns
from fast.depthwise import Depthwise
from fast.fast_layer import FastLayer
from fast.fusing import After, after_of
from fast.geometry import Algorithm, ByGroup, Geometry
from fast.row_tiles import RowTiles
from fast.row_winograd import TILE, RowWinograd
from fast.rows import Rows
from fast.tiles import FastBlob, pitch_of, tile_of
from fast.window_tiles import WindowTiles
from fast.winograd import Winograd
from layers.vision.convolution import Convolution
from layers.vision.deconvolution import Deconvolution
from layers.vision.depthwise_convolution import ConvolutionDepthwise, DepthwiseConvolution
from netlib.blob import Array, Blob, Blobs


@dataclass(frozen=True)
class Sizes:
    """Sizes of a sum over windows: x (images, inputs, \\*sizes) and y (images, outputs, \\*windows), for one group."""

    geometry: Geometry
    images: int
    inputs: int
    sizes: tuple[int, ...]
    outputs: int
    windows: tuple[int, ...]

    @property
    def is_undilated(self) -> bool:
        """Whether this is a sum over images without dilation."""
        return len(self.sizes) == 2 and set(self.geometry.dilation) == {1}

    @property
    def turned(self) -> Sizes:
        """The sizes of the convolution with the flipped kernel that computes dx."""
        return Sizes(self.geometry.turned, self.images, self.outputs, self.windows, self.inputs, self.sizes)


def is_depthwise(s: Sizes) -> bool:
    """One channel per group of an image. It takes a third to two thirds of the time of Columns."""
    return len(s.sizes) == 2 and s.geometry.group > s.inputs == 1


def has_wide_rows(s: Sizes, least: int = 6) -> bool:
    """5 x 5, or 3 x 3 with fewer channels and smaller maps than is_wide, and enough channels to make the time of the
    transforms small. Up to twice as fast as the next."""
    if not s.geometry.is_dense or s.geometry.kernel not in ((3, 3), (5, 5)):
        return False
    area, channels, total = s.inputs * math.prod(s.sizes), s.inputs * s.outputs, s.inputs + s.outputs
    if s.geometry.kernel == (5, 5):
        return channels >= least * total and s.images * area >= 4096
    return channels >= 16 * total and total <= 192 and s.images >= 8 and area <= 1 << 16


def has_wide_rows_for_weights(s: Sizes) -> bool:
    """For dw with fewer channels, because dy has no values to be added."""
    return has_wide_rows(s, 2)


def is_wide(s: Sizes) -> bool:
    """3 x 3, with enough channels to make the time of the transforms small, more if the last tiles extend far beyond
    the map, and enough tiles to make that of the weights small. Up to twice as fast."""
    if not _is_tiled(s, tiles=24):
        return False
    waste = math.prod(-(-n // TILE) * TILE / n for n in s.windows)
    return s.inputs * s.outputs >= 20 * waste**3 * (s.inputs + s.outputs)


def is_wide_batch(s: Sizes) -> bool:
    """For dw with fewer channels, and with more tiles, because each block adds four times as many values as the weights
    have."""
    return _is_tiled(s, tiles=96) and s.inputs * s.outputs >= 12 * (s.inputs + s.outputs)


def _is_tiled(s: Sizes, tiles: int) -> bool:
    """Whether this is a sum over adjacent 3 x 3 windows with at least this number of tiles."""
    if not s.geometry.is_dense or s.geometry.kernel != (3, 3):
        return False
    return s.images * math.prod(-(-n // TILE) for n in s.windows) >= tiles


def has_few_outputs(s: Sizes) -> bool:
    """Few outputs, so that copying takes as long as the product, and long rows. Up to twice as fast."""
    if not s.is_undilated or not all(k > n for k, n in zip(s.geometry.kernel, s.geometry.stride)):
        return False
    length, weights = s.images * s.windows[-1], s.inputs * math.prod(s.geometry.kernel) * s.outputs
    return 8 <= s.outputs <= 96 and length >= (16 if weights <= 60_000 else 64)


def has_small_kernel(s: Sizes) -> bool:
    """For dw also few weights, because there is a product for each row of outputs. Up to 1.4 times as fast."""
    return has_few_outputs(s) and s.inputs * math.prod(s.geometry.kernel) * s.outputs <= 60_000


def is_any(s: Sizes) -> bool:
    """All other sizes."""
    return True


# Algorithm, its sizes for y and dx, its sizes for dw
ALGORITHMS: tuple[tuple[Algorithm, Callable[[Sizes], bool], Callable[[Sizes], bool]], ...] = (
    (Depthwise(), is_depthwise, is_depthwise),
    (RowWinograd(), has_wide_rows, has_wide_rows_for_weights),
    (Winograd(), is_wide, is_wide_batch),
    (Rows(), has_few_outputs, has_small_kernel),
    (Columns(), is_any, is_any),
)


@dataclass(frozen=True)
class Choice:
    """The algorithm of each of the three sums."""

    correlate: Algorithm
    transpose: Algorithm
    gradient: Algorithm


def choose(g: Geometry, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Choice | None:
    """The fastest algorithms for x (N, C, ...) and y (N, O, ...); None for the plain layer."""
    if not g.kernel:
        return None
    N, C, *sizes = x_shape
    s = Sizes(g, N, C // g.group, tuple(sizes), y_shape[1] // g.group, y_shape[2:])
    correlate = next(algorithm for algorithm, fits, _ in ALGORITHMS if fits(s))
    gradient = next(algorithm for algorithm, _, fits in ALGORITHMS if fits(s))
    transpose: Algorithm = Columns()
    if is_depthwise(s):
        transpose = correlate
    elif g.is_turnable(x_shape, y_shape, 2.5 if has_wide_rows(s.turned) else 1.3):
        transpose = next(algorithm for algorithm, fits, _ in ALGORITHMS if fits(s.turned))
    return Choice(*(by_group(g, algorithm) for algorithm in (correlate, transpose, gradient)))


def by_group(g: Geometry, algorithm: Algorithm) -> Algorithm:
    """The algorithm, for several groups if it supports only one."""
    return ByGroup(algorithm) if g.group > 1 and isinstance(algorithm, (RowWinograd, Winograd, Rows)) else algorithm


class FastConvolution(FastLayer, Convolution):
    """Convolution by the algorithm that is the fastest for its shapes.

    tiles      the algorithm on tiles, or None
    algorithm  the algorithms on arrays, or None for the plain layer
    """

    tiles: RowTiles | WindowTiles | None = None
    algorithm: Choice | None = None

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the geometry, and create the algorithms that keep matrices of the weights."""
        super().setup(bottom, top)
        self.geometry = Geometry(self.kernel, self.stride, self.pad, self.dilation, self.param.group)
        self.row_tiles, self.window_tiles = RowTiles(), WindowTiles()

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The tile of the top, or a size for which the matrix product is fast; None if not computed on tiles."""
        return self.row_tiles.tile(top_tile, self.weight.shape) if self.tiles else None

    def writes_tiles(self) -> bool:
        """Whether RowTiles or WindowTiles computes the layer; they write tiles of any size."""
        return self.tiles is not None

    def writes_sparse(self) -> bool:
        """Whether the top can be sparse: True if the gradient of the bottom is not needed."""
        return self.tiles is not None and not self.needs_bottom_diff

    def fuses_relu(self) -> bool:
        """Whether the algorithm computes what is behind the layer: not on tiles, nor in the plain layer."""
        return self.tiles is None and self.algorithm is not None

    def fuses_channels(self) -> bool:
        """The same, if the outputs are the channels of the top."""
        return self.fuses_relu() and self.axis == 1

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and choose the algorithm."""
        super().reshape(bottom, top)
        self.tiles = self.row_tiles if RowTiles.fits(self.geometry, self.weight.shape) and self.axis == 1 else None
        for x, y in zip(bottom, top):
            if isinstance(y, FastBlob) and y.tile is not None:
                y.pitch = -(-(pitch_of(x) or x.width) // y.tile) * y.tile
        if len(top) == 1 and self.tiles:
            may = isinstance(top[0], FastBlob) and top[0].may_be_sparse
            if may and WindowTiles.fits(bottom[0], tile_of(top[0]), self.weight):
                self.tiles = self.window_tiles
        self.algorithm = choose(self.geometry, *by_image(self.axis, bottom[0], top[0]))

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        bias = self.bias.data if self.param.bias_term else None
        if self.tiles:
            for x, y in zip(bottom, top):
                self.tiles.forward(self, x, y, self.weight.data, bias)
        elif self.algorithm:
            w, after = self.weight.data, after_of(bias, self.after)
            if after.gain is not None and 2 * w.size < top[0].count:  # scaling the weights takes less time
                w, after = w * after.gain.reshape(-1, *(1,) * (w.ndim - 1)), replace(after, gain=None)
            for x, y in zip(bottom, top):
                arrays = self.images(x.data), w, after, self.images(y.data)
                self.algorithm.correlate.correlate(self.geometry, *arrays)
        else:
            super().forward(bottom, top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        w, dw = self.weight.data, self.weight.diff
        db = self.bias.diff if self.param.bias_term else None
        if self.tiles:
            for x, y, down in zip(bottom, top, propagate_down):
                self.tiles.backward(self, x, y, w, dw, db, down)
        elif self.algorithm:
            for x, y, down in zip(bottom, top, propagate_down):
                dy = self.images(y.diff)
                self.algorithm.gradient.gradient(self.geometry, self.images(x.data), dy, dw)
                if db is not None:
                    db += sum_by_channel(dy)
                if down:
                    self.algorithm.transpose.transpose(self.geometry, dy, w, After(), self.images(x.diff))
        else:
            super().backward(top, propagate_down, bottom)


class FastDepthwiseConvolution(FastConvolution, DepthwiseConvolution):
    """Convolution of each channel on its own."""


class FastConvolutionDepthwise(FastConvolution, ConvolutionDepthwise):
    """Convolution of each channel on its own, with as many outputs as channels."""


class FastDeconvolution(FastLayer, Deconvolution):
    """Deconvolution by the algorithm that is the fastest for its shapes; None for the plain layer."""

    algorithm: Choice | None = None

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the geometry."""
        super().setup(bottom, top)
        self.geometry = Geometry(self.kernel, self.stride, self.pad, self.dilation, self.param.group)

    def fuses_relu(self) -> bool:
        """Whether the algorithm computes what is behind the layer: not on tiles, nor in the plain layer."""
        return self.algorithm is not None

    def fuses_channels(self) -> bool:
        """The same, if the outputs are the channels of the top."""
        return self.fuses_relu() and self.axis == 1

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and choose the algorithm."""
        super().reshape(bottom, top)
        self.algorithm = choose(self.geometry, *by_image(self.axis, top[0], bottom[0]))

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        if not self.algorithm:
            super().forward(bottom, top)
            return
        after = after_of(self.bias.data if self.param.bias_term else None, self.after)
        for x, y in zip(bottom, top):
            arrays = self.images(x.data), self.weight.data, after, self.images(y.data)
            self.algorithm.transpose.transpose(self.geometry, *arrays)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        if not self.algorithm:
            super().backward(top, propagate_down, bottom)
            return
        for x, y, down in zip(bottom, top, propagate_down):
            dy = self.images(y.diff)
            if self.param.bias_term:
                self.bias.diff[...] += sum_by_channel(dy)
            if down and max(self.geometry.stride) > 1:  # one set of columns takes less time than two fast algorithms
                arrays = self.images(x.data), self.images(x.diff), self.weight.diff
                Columns().correlate_and_gradient(self.geometry, dy, self.weight.data, *arrays)
                continue
            self.algorithm.gradient.gradient(self.geometry, dy, self.images(x.data), self.weight.diff)
            if down:
                self.algorithm.correlate.correlate(self.geometry, dy, self.weight.data, After(), self.images(x.diff))


def by_image(axis: int, *blobs: Blob) -> list[tuple[int, ...]]:
    """The shapes (N, C, ...) of blobs whose channels are on this axis."""
    return [(math.prod(blob.shape[:axis]), *blob.shape[axis:]) for blob in blobs]


def sum_by_channel(dy: Array) -> Array:
    """The sum (O,) of dy (N, O, ...) over images and positions."""
    total: Array = dy.sum(axis=tuple(range(2, dy.ndim))).sum(axis=0)
    return total
