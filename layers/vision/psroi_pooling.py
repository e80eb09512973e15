"""PSROIPooling: means over a grid in each region of interest, each from separate maps (R-FCN).

bottom[0]  x     (N, K G G, H, W)   G = group_size, K = output_dim
bottom[1]  rois  (R, 5)             item, x1, y1, x2, y2: corners in the image, both
                                    inside the region
top[0]     y     (R, K, G, G)

y[r, k, i, j] = mean of x[n, (k G + i) G + j] over bin (i, j) of region r
dx += dy / pixels of the bin

The corners are rounded, halves away from zero, and multiplied by ``spatial_scale``
(map size / image size): the region begins at x1 and ends before x2 + 1. It is divided into G x G
bins of equal size, at least 0.1 / G; a bin covers all pixels that it touches, clipped to the map.
An empty bin is 0 and has no gradient. The gradient of rois is 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from layers.vision.roi_pooling import checked_rois, rounded
from netlib.blob import Array, Blobs
from netlib.layer import ZeroGradient
from netlib.proto.schema import Natural, numbered

MIN_SIZE = 0.1  # of a region in the map, as in Caffe


@dataclass(frozen=True)
class PSROIPoolingParameter:
    """The ``psroi_pooling_param { ... }`` block."""

    spatial_scale: float = numbered(1)  # positions of the map per pixel of the image
    output_dim: Natural = numbered(2)  # channels of the top
    group_size: Natural = numbered(3)  # rows and columns of the grid


class PSROIPooling(ZeroGradient):
    """Mean pooling of regions of interest, with other maps for each bin."""

    param: PSROIPoolingParameter
    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.output_dim < 1 or self.param.group_size < 1:
            raise self.fail("output_dim and group_size must be at least 1")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        K, G = self.param.output_dim, self.param.group_size
        x, rois = (blob.shape for blob in bottom)
        if len(x) != 4 or x[1] != K * G * G:
            name = self.spec.bottom[0]
            raise self.fail(
                f"bottom {name!r} has shape {x}, expected (N, {K * G * G}, H, W) for "
                f"output_dim {K} and group_size {G}"
            )
        if rois[1:2] != (5,) or bottom[1].count != 5 * rois[0]:
            raise self.fail(f"bottom {self.spec.bottom[1]!r} has shape {rois}, expected (R, 5)")
        top[0].reshape(rois[0], K, G, G)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        y = top[0].data
        y[...] = 0
        for r, i, j, maps in self._bins(bottom, bottom[0].data):
            y[r, :, i, j] = maps.mean(axis=(1, 2))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        if propagate_down[0]:
            for r, i, j, maps in self._bins(bottom, bottom[0].diff):
                share = top[0].diff[r, :, i, j] / self.dtype.type(maps[0].size)
                maps += share[:, None, None]

    def _bins(self, bottom: Blobs, values: Array) -> Iterator[tuple[int, int, int, Array]]:
        """Region, row and column of each bin that is not empty, with the part (K, h, w) of
        ``values`` that it covers.

        Raises LayerError if a region is invalid.
        """
        G, (H, W) = self.param.group_size, values.shape[2:]
        rois = checked_rois(self, bottom)
        grid = values.reshape(len(values), self.param.output_dim, G, G, H, W)
        scale = self.dtype.type(self.param.spatial_scale)
        items = rois[:, 0].astype(int)
        boxes = rounded(rois[:, 1:]) + (0, 0, 1, 1)  # to the ends of the last pixels
        for r, (n, box) in enumerate(zip(items, boxes)):
            x1, y1, x2, y2 = (box.astype(self.dtype) * scale).tolist()
            rows, columns = self._spans(y1, y2, H), self._spans(x1, x2, W)
            for i, j in np.ndindex(G, G):
                maps = grid[n, :, i, j, rows[i], columns[j]]
                if maps[0].size:
                    yield r, i, j, maps

    def _spans(self, begin: float, end: float, size: int) -> list[slice]:
        """The pixels of a region's bins along one axis, clipped to the map."""
        first, last, least = np.array([begin, end, MIN_SIZE], self.dtype)
        length = max(last - first, least) / self.dtype.type(self.param.group_size)
        number = np.arange(self.param.group_size + 1, dtype=self.dtype)  # rounding as in Caffe
        begins = np.floor(number[:-1] * length + first).clip(0, size)
        ends = np.ceil(number[1:] * length + first).clip(0, size)
        return [slice(int(a), int(b)) for a, b in zip(begins, ends)]
