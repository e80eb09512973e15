"""FastConvolution: convolutions with stride 1, no padding and one group, with less copying than im2col.

Two algorithms use matrix products: row_tiles.py for all such convolutions, window_tiles.py for the first layer on a
depth image, where the background needs no product. Other options are computed by the plain layer.
"""

from __future__ import annotations

from fast.fast_layer import FastLayer
from fast.row_tiles import RowTiles
from fast.tiles import FastBlob, pitch_of, tile_of
from fast.window_tiles import WindowTiles
from layers.vision.convolution import Convolution
from netlib.blob import Blobs


class FastConvolution(FastLayer, Convolution):
    """Convolution computed on tiles."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Create both algorithms."""
        super().setup(bottom, top)
        self.row_tiles, self.window_tiles = RowTiles(), WindowTiles()
        self.way: RowTiles | WindowTiles = self.row_tiles

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The tile of the top, or a size for which the matrix product is fast; None for options of the plain layer."""
        return self.row_tiles.tile(top_tile, self.weight.shape) if self.simple else None

    def writes_tiles(self) -> bool:
        """Whether RowTiles or WindowTiles computes the layer; they write tiles of any size."""
        return self.simple

    def writes_sparse(self) -> bool:
        """Whether the top can be sparse: True if the gradient of the bottom is not needed."""
        return self.simple and not self.needs_bottom_diff

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and select the plain layer or one of the two algorithms."""
        super().reshape(bottom, top)
        options = self.stride == self.dilation == (1, 1) and self.pad == (0, 0) and self.param.group == 1
        self.simple = options and len(bottom[0].shape) == 4
        for x, y in zip(bottom, top):
            if isinstance(y, FastBlob) and y.tile is not None:
                y.pitch = -(-(pitch_of(x) or x.width) // y.tile) * y.tile
        if len(top) == 1 and self.simple:
            may = isinstance(top[0], FastBlob) and top[0].may_be_sparse
            fits = may and WindowTiles.fits(bottom[0], tile_of(top[0]), self.weight)
            self.way = self.window_tiles if fits else self.row_tiles

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute each top from its bottom."""
        if not self.simple:
            super().forward(bottom, top)
            return
        bias = self.bias.data if self.param.bias_term else None
        for x, y in zip(bottom, top):
            self.way.forward(self, x, y, self.weight.data, bias)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients for each bottom; the diffs of the parameters are summed."""
        if not self.simple:
            super().backward(top, propagate_down, bottom)
            return
        w, dw = self.weight.data, self.weight.diff
        db = self.bias.diff if self.param.bias_term else None
        for x, y, down in zip(bottom, top, propagate_down):
            self.way.backward(self, x, y, w, dw, db, down)
