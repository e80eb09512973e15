"""FastConvolution and FastDeconvolution: each chooses an algorithm for the shapes of its blobs.

The first entry of the table that fits is used. It says for which shapes it is the fastest.

    algorithm      shapes
    WindowTiles    one channel, mostly constant, with a max pooling behind it, as in a depth image's first layer
    RowTiles       stride 1 without padding and groups, next to a pooling that reads its tiles
    Columns        all others with at least one spatial axis
    plain layer    no spatial axis

A deconvolution is the transpose of a convolution from its top to its bottom and uses the same algorithms, except tiles.
"""

from __future__ import annotations

from fast.columns import Columns
from fast.fast_layer import FastLayer
from fast.geometry import Algorithm, Geometry
from fast.row_tiles import RowTiles
from fast.tiles import FastBlob, pitch_of, tile_of
from fast.window_tiles import WindowTiles
from layers.vision.convolution import Convolution
from layers.vision.deconvolution import Deconvolution
from netlib.blob import Array, Blobs


class FastConvolution(FastLayer, Convolution):
    """Convolution by the algorithm that is the fastest for its shapes.

    tiles      the algorithm on tiles, or None
    algorithm  the algorithm on arrays, or None for the plain layer
    """

    tiles: RowTiles | WindowTiles | None = None
    algorithm: Algorithm | None = None

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
        self.algorithm = choose(self.geometry)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        bias = self.bias.data if self.param.bias_term else None
        if self.tiles:
            for x, y in zip(bottom, top):
                self.tiles.forward(self, x, y, self.weight.data, bias)
        elif self.algorithm:
            for x, y in zip(bottom, top):
                arrays = self.images(x.data), self.weight.data, bias, self.images(y.data)
                self.algorithm.correlate(self.geometry, *arrays)
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
                self.algorithm.gradient(self.geometry, self.images(x.data), dy, dw)
                if db is not None:
                    db += sum_by_channel(dy)
                if down:
                    self.algorithm.transpose(self.geometry, dy, w, None, self.images(x.diff))
        else:
            super().backward(top, propagate_down, bottom)


class FastDeconvolution(FastLayer, Deconvolution):
    """Deconvolution by the algorithm that is the fastest for its shapes; None for the plain layer."""

    algorithm: Algorithm | None = None

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the geometry."""
        super().setup(bottom, top)
        self.geometry = Geometry(self.kernel, self.stride, self.pad, self.dilation, self.param.group)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and choose the algorithm."""
        super().reshape(bottom, top)
        self.algorithm = choose(self.geometry)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        if not self.algorithm:
            super().forward(bottom, top)
            return
        bias = self.bias.data if self.param.bias_term else None
        for x, y in zip(bottom, top):
            arrays = self.images(x.data), self.weight.data, bias, self.images(y.data)
            self.algorithm.transpose(self.geometry, *arrays)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        if not self.algorithm:
            super().backward(top, propagate_down, bottom)
            return
        for x, y, down in zip(bottom, top, propagate_down):
            dy = self.images(y.diff)
            self.algorithm.gradient(self.geometry, dy, self.images(x.data), self.weight.diff)
            if self.param.bias_term:
                self.bias.diff[...] += sum_by_channel(dy)
            if down:
                self.algorithm.correlate(self.geometry, dy, self.weight.data, None, self.images(x.diff))


def choose(g: Geometry) -> Algorithm | None:
    """The algorithm on arrays that is the fastest for these shapes; None for the plain layer."""
    return Columns() if g.kernel else None


def sum_by_channel(dy: Array) -> Array:
    """The sum (O,) of dy (N, O, ...) over images and positions."""
    total: Array = dy.sum(axis=tuple(range(2, dy.ndim))).sum(axis=0)
    return total
