"""Upsample without a mask: repeat rows and columns (YOLO).

bottom[0]  x  (..., H, W)
top[0]     y  (..., H s, W s)      s = ``scale``, 1 by default

y[..., h, w]  = x[..., floor(h / s), floor(w / s)]
dx[..., i, j] = sum of dy over the s x s copies

With a mask as second bottom, Upsample is another layer (upsample.py), with more options.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from layers.vision.upsample import UpsampleParameter
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto import schema

WITH_MASK = ("scale_h", "scale_w", "pad_out_h", "pad_out_w", "upsample_h", "upsample_w")


class NearestUpsample(Layer):
    """Repeats rows and columns."""

    param: UpsampleParameter
    param_name = "upsample_param"
    bottoms = tops = (1, 1)
    in_place = False
    batchwise = True
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        for name in WITH_MASK:
            if schema.is_set(self.param, name):
                raise self.fail(
                    f"{name} needs the mask of a Pooling, its second top, as second bottom; "
                    "with one bottom, Upsample reads only scale",
                    name,
                )
        self.scale = 1 if self.param.scale is None else self.param.scale
        if self.scale < 1:
            raise self.fail("scale must be at least 1", "scale")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape = bottom[0].shape
        if len(shape) < 2:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {shape}, expected (..., H, W)"
            )
        *before, H, W = shape
        top[0].reshape(*before, H * self.scale, W * self.scale)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        rows = bottom[0].data.repeat(self.scale, axis=-1)
        for i in range(self.scale):
            top[0].data[..., i :: self.scale, :] = rows

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            s, dy = self.scale, top[0].diff  # dy.sum over axes of s values takes ten times as long
            rows = reduce(np.add, (dy[..., i::s, :] for i in range(s)))
            bottom[0].diff[...] = reduce(np.add, (rows[..., j::s] for j in range(s)))
