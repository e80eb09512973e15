"""FastConvolution: stride 1, no padding, one group, as the hand network has it, with less copying than im2col.

Two ways, both by matrix products: row_tiles.py for any such convolution, window_tiles.py for the first one of a depth
image, whose background needs no product. Other options are the plain layer's.
"""

from __future__ import annotations

from fast.fast_layer import FastLayer
from fast.row_tiles import RowTiles
from fast.tiles import FastBlob, pitch_of, tile_of
from fast.window_tiles import WindowTiles
from layers.vision.convolution import Convolution
from netlib.blob import Blobs


class FastConvolution(FastLayer, Convolution):
    """Convolution on tiles."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Prepare both ways."""
        super().setup(bottom, top)
        self.row_tiles, self.window_tiles = RowTiles(), WindowTiles()
        self.way: RowTiles | WindowTiles = self.row_tiles

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """What makes a product of a good shape, if the top leaves the choice."""
        return self.row_tiles.tile(top_tile, self.weight.shape) if self.simple else None

    def writes_tiles(self) -> bool:
        """Of any size."""
        return self.simple

    def writes_sparse(self) -> bool:
        """True if the gradient of the image is not needed."""
        return self.simple and not self.needs_bottom_diff

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Choose between the plain layer and the two ways."""
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
        """Bottom by bottom."""
        if not self.simple:
            super().forward(bottom, top)
            return
        bias = self.bias.data if self.param.bias_term else None
        for x, y in zip(bottom, top):
            self.way.forward(self, x, y, self.weight.data, bias)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Bottom by bottom."""
        if not self.simple:
            super().backward(top, propagate_down, bottom)
            return
        w, dw = self.weight.data, self.weight.diff
        db = self.bias.diff if self.param.bias_term else None
        for x, y, down in zip(bottom, top, propagate_down):
            self.way.backward(self, x, y, w, dw, db, down)
