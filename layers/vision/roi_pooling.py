"""ROIPooling: max pooling over a grid in each region of interest (Fast R-CNN).

bottom[0]  x     (N, C, H, W)
bottom[1]  rois  (R, 5)           item, x1, y1, x2, y2: corners in the image, both inside the region
top[0]     y     (R, C, Ph, Pw)   Ph = pooled_h, Pw = pooled_w

y[r, c, i, j] = max of x[n, c] over bin (i, j) of region r
dx[the first of the equal winners] += dy

The corners are multiplied by ``spatial_scale`` (map size / image size) and rounded, halves
away from zero. The region then has y2 - y1 + 1 rows, at least one. Bin i of Ph covers rows
floor(i rows / Ph) up to but not including ceil((i + 1) rows / Ph) of the region, so bins
may overlap; they are clipped to the map. An empty bin is 0 and has no gradient. The
gradient of rois is 0.

Kept for backward: ``winners``, index h W + w of each maximum in the map; -1 if the bin is empty.
The block has number 8266711 in Fast R-CNN's LayerParameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.common.images import check_images
from netlib.blob import Array, Blobs
from netlib.layer import Layer, ZeroGradient
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class ROIPoolingParameter:
    """The ``roi_pooling_param { ... }`` block."""

    pooled_h: UInt = numbered(1, 0)  # rows of the grid
    pooled_w: UInt = numbered(2, 0)  # columns of the grid
    spatial_scale: float = numbered(3, 1.0)  # positions of the map per pixel of the image


class ROIPooling(ZeroGradient):
    """Max pooling of regions of interest."""

    param: ROIPoolingParameter
    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if 0 in (self.param.pooled_h, self.param.pooled_w):
            raise self.fail("needs pooled_h and pooled_w of at least 1")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, rois = (blob.shape for blob in bottom)
        check_images(self, bottom[:1])
        if rois[1:2] != (5,) or bottom[1].count != 5 * rois[0]:
            raise self.fail(f"bottom {self.spec.bottom[1]!r} has shape {rois}, expected (R, 5)")
        top[0].reshape(rois[0], x[1], self.param.pooled_h, self.param.pooled_w)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = bottom[0].data, top[0].data
        rois = checked_rois(self, bottom)
        self.items = rois[:, 0].astype(int)
        corners = rounded(rois[:, 1:] * self.dtype.type(self.param.spatial_scale))
        self.winners = np.full(y.shape, -1)
        y[...] = 0
        for r, (n, (x1, y1, x2, y2)) in enumerate(zip(self.items, corners)):
            rows = self._bins(y1, y2, y.shape[2], x.shape[2])
            columns = self._bins(x1, x2, y.shape[3], x.shape[3])
            for i, j in np.ndindex(y.shape[2:]):
                (top_row, end), (left, right) = rows[i], columns[j]
                if top_row < end and left < right:
                    flat = x[n, :, top_row:end, left:right].reshape(x.shape[1], -1)
                    h, w = np.divmod(flat.argmax(axis=1), right - left)
                    y[r, :, i, j] = flat.max(axis=1)
                    self.winners[r, :, i, j] = (top_row + h) * x.shape[3] + left + w

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        if propagate_down[0]:
            maps = bottom[0].diff.reshape(*bottom[0].shape[:2], -1)
            filled = np.nonzero(self.winners >= 0)
            r, c, _, _ = filled
            np.add.at(maps, (self.items[r], c, self.winners[filled]), top[0].diff[filled])

    def _bins(self, first: int, last: int, bins: int, size: int) -> list[tuple[int, int]]:
        """Start and end of a region's bins along one axis, clipped to the map."""
        # rounding as in Caffe
        length = self.dtype.type(max(last - first + 1, 1)) / self.dtype.type(bins)
        number = np.arange(bins + 1, dtype=self.dtype)
        begins = first + np.floor(number[:-1] * length).astype(int)
        ends = first + np.ceil(number[1:] * length).astype(int)
        return list(zip(begins.clip(0, size).tolist(), ends.clip(0, size).tolist()))


def checked_rois(layer: Layer, bottom: Blobs) -> Array:
    """The regions (R, 5) in bottom[1].

    Raises LayerError if one has an item that bottom[0] lacks, or is not finite.
    """
    rois, N = bottom[1].data.reshape(-1, 5), bottom[0].shape[0]
    items = rois[:, 0]
    is_valid = np.isfinite(rois).all(axis=1) & (items >= 0) & (items < N)
    for r in np.flatnonzero(~is_valid)[:1]:
        numbers = ", ".join(f"{value:g}" for value in rois[r])
        raise layer.fail(
            f"row {r} of {layer.spec.bottom[1]!r} is ({numbers}); "
            f"expected an item from 0 to {N - 1} and four finite coordinates"
        )
    return rois


def rounded(values: Array) -> Array:
    """Integers, with halves rounded away from zero."""
    wide = values.astype(np.float64)
    return (np.sign(wide) * np.floor(np.abs(wide) + 0.5)).astype(int)
