r"""Interp: bilinear resampling of an image, corners aligned (DeepLab, PSPNet).

bottom[0]  x     (N, C, H, W)
bottom[1]  size  (..., Ho, Wo)    optional; only its shape is read
top[0]     y     (N, C, Ho, Wo)

Row h of y is at p = h (H - 1) / (Ho - 1) among the rows of x, and at 0 if Ho = 1, so the first
and the last rows meet. With i = floor(p), its value is (1 - p + i) x[i] + (p - i) x[i + 1].
This is a matrix R (Ho, H) with at most two weights in each row; columns have a matrix K (Wo, W)
in the same way:

    y = R x Kᵀ        dx = Rᵀ dy K        for each map

Before that, x is cropped by -``pad_beg`` rows and columns at the beginning and -``pad_end`` at the
end; dx is 0 there. The size of y is given by, in this order,

    bottom[1], with use_blob_size
    shrink_factor s           Ho = floor((H - 1) / s) + 1
    zoom_factor z             Ho = (H - 1) z + 1
    height and width
    shrink_factor and zoom_factor    the first, and then the second
    bottom[1]

The forks of Caffe compute p in single precision. The gradient of size is 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from layers.common.images import check_images
from netlib.blob import Array, Blobs
from netlib.layer import ZeroGradient, warn, warn_of_ignored
from netlib.proto import schema
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class InterpParameter:
    """The ``interp_param { ... }`` block."""

    height: int = numbered(1, 0)
    width: int = numbered(2, 0)
    zoom_factor: int = numbered(3, 1)
    shrink_factor: int = numbered(4, 1)
    # rows and columns to add at the beginning; only 0 and negative numbers
    pad_beg: int = numbered(5, 0)
    pad_end: int = numbered(6, 0)
    use_blob_size: bool = numbered(7, False)  # of bottom[1], whatever the other options say


class Interp(ZeroGradient):
    """Bilinear resampling with aligned corners."""

    param: InterpParameter
    bottoms = (1, 2)
    tops = (1, 1)
    in_place = False
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        self.batchwise = len(bottom) == 1  # a second bottom may have another number of items
        for name in ("zoom_factor", "shrink_factor"):
            if getattr(p, name) < 1:
                raise self.fail(f"{name} is {getattr(p, name)}, expected at least 1", name)
        for name in ("pad_beg", "pad_end"):
            if getattr(p, name) > 0:
                raise self.fail(
                    f"{name} is {getattr(p, name)}; as in Caffe's forks, only cropping is supported: "
                    "expected 0 or less",
                    name,
                )
        given = {
            name
            for name in ("height", "width", "zoom_factor", "shrink_factor")
            if schema.is_set(p, name)
        }
        if len(given & {"height", "width"}) == 1:
            raise self.fail("needs both height and width", next(iter(given & {"height", "width"})))
        factors = given & {"zoom_factor", "shrink_factor"}
        self.by_factors = len(factors) == 1 or (bool(factors) and "height" not in given)
        if p.use_blob_size:
            if len(bottom) == 1:
                raise self.fail(
                    "use_blob_size needs a second bottom with the size", "use_blob_size"
                )
            if given:
                warn_of_ignored(self, *sorted(given))
            given, self.by_factors = set(), False
        elif not given and len(bottom) == 1:
            raise self.fail(
                "needs height and width, zoom_factor, shrink_factor, or a second bottom with the size"
            )
        if "height" in given and factors:
            names = ("height", "width") if self.by_factors else ("zoom_factor", "shrink_factor")
            warn_of_ignored(self, *names)
        if given and len(bottom) == 2:
            warn(
                self,
                f"the size of bottom {self.spec.bottom[1]!r} is ignored, because {min(given)} is given",
            )
        self.from_bottom = not given

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        check_images(self, bottom)
        N, C, *whole = bottom[0].shape
        sizes = [n + p.pad_beg + p.pad_end for n in whole]
        if min(sizes) < 1:
            name = self.spec.bottom[0]
            raise self.fail(
                f"bottom {name!r} {bottom[0].shape} is empty after cropping by "
                f"pad_beg {p.pad_beg} and pad_end {p.pad_end}"
            )
        if self.by_factors:
            shrunk = [(n - 1) // p.shrink_factor + 1 for n in sizes]
            outputs = [(n - 1) * p.zoom_factor + 1 for n in shrunk]
        else:
            outputs = [*bottom[1].shape[2:]] if self.from_bottom else [p.height, p.width]
        if min(outputs) < 1:
            raise self.fail(
                f"the size of the top is {outputs[0]} x {outputs[1]}, expected at least 1 x 1",
                "height",
            )
        self.inside: tuple[Any, ...] = (..., *(slice(-p.pad_beg, -p.pad_beg + n) for n in sizes))
        self.rows, self.columns = (self._weights(n, count) for n, count in zip(sizes, outputs))
        top[0].reshape(N, C, *outputs)

    def _weights(self, size: int, count: int) -> Array:
        """The matrix (count, size) that resamples an axis."""
        steps = max(count - 1, 1)
        whole, rest = np.divmod(np.arange(count) * (size - 1), steps)
        weights = np.zeros((count, size + 1), self.dtype)
        weights[np.arange(count), whole] = 1 - rest / steps
        weights[np.arange(count), whole + 1] = rest / steps
        return weights[:, :size]  # where the column behind the axis was used, its weight is 0

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = self.rows @ bottom[0].data[self.inside] @ self.columns.T

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        if propagate_down[0]:
            bottom[0].diff[self.inside] = self.rows.T @ top[0].diff @ self.columns
