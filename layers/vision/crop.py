"""Crop: crop a blob to the size of another.

bottom[0]  x     any shape
bottom[1]  size  same number of axes; only its shape is read
top[0]     y     the axes of x before ``axis``, then those of size

y  = x from ``offset`` on (default 0; one number, or one per axis), along ``axis`` and later axes
dx = dy where y came from, 0 elsewhere        the gradient of size is 0
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import ZeroGradient, warn
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class CropParameter:
    """The ``crop_param { ... }`` block."""

    axis: int = numbered(1, 2)  # first axis to crop; the default crops rows and columns of images
    offset: tuple[UInt, ...] = numbered(2, ())  # start of y in x


class Crop(ZeroGradient):
    """Crops to the size of another blob."""

    param: CropParameter
    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        x, size = bottom[0].shape, bottom[1].shape
        middle = [(n - m) // 2 for n, m in zip(x, size)][self.param.axis :]
        if any(middle) and not self.param.offset:  # where only one value is cut, both align alike
            warn(
                self,
                f"without an offset, the first {size} of {x} remain, as in Caffe 1.0; Caffe's forks of FCN, HED and "
                f"U-Net align both, near the offsets {middle} (caffe.coord_map gives the exact ones)",
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, size = bottom[0].shape, bottom[1].shape
        axis, offsets = self.canonical_axis(self.param.axis, bottom[0]), self.param.offset or (0,)
        cut = len(x) - axis
        if len(offsets) not in (1, cut):
            raise self.fail(
                f"{len(offsets)} values of offset for {cut} axes from axis {axis} of {x} on",
                "offset",
            )
        starts = offsets if len(offsets) == cut else offsets * cut
        ends = [start + n for start, n in zip(starts, size[axis:])]
        is_inside = all(end <= n for end, n in zip(ends, x[axis:]))
        if len(size) < len(x) or not is_inside:
            whole, other = self.spec.bottom
            raise self.fail(
                f"bottom {whole!r} {x} does not contain {other!r} {size} "
                f"at offset {starts}, from axis {axis} on",
                "offset",
            )
        self.part = (*[slice(None)] * axis, *map(slice, starts, ends))
        top[0].reshape(*x[:axis], *size[axis : len(x)])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data[self.part]

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        if propagate_down[0]:
            bottom[0].diff[self.part] = top[0].diff
