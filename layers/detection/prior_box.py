"""PriorBox: the default boxes of a feature map, which DetectionOutput moves and scales (SSD).

bottom[0]  map    (N, C, H, W); only H and W are used
bottom[1]  image  (N, C, height, width); its size is used unless given by ``img_size``, or
                  ``img_h`` and ``img_w``
top[0]     y      (1, 2, H W P 4): y[0, 0] the boxes, y[0, 1] their variances

Position (h, w) of the map has P boxes with their centre at

    x = (w + offset) step_w,    y = (h + offset) step_h
    step = size of the image / size of the map, or given

For each min_size m these are, in sequence, width x height

    m x m,    √(m M) x √(m M) with max_size M,    m √r x m / √r for each ratio r other than 1

where each ``aspect_ratio`` is followed by its inverse (``flip``), and a ratio that already occurred
is skipped. A box is (xmin, ymin, xmax, ymax), divided by the width and height of the image;
``clip`` limits it to [0, 1].

The top does not depend on the values of the bottoms, so their gradients are 0.

Fractions of min_size and max_size are kept, as in OpenCV and later forks; the SSD branch itself
truncates them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import ZeroGradient
from netlib.proto.schema import UInt, numbered

SAME = 1e-6  # ratios that differ by less are the same, as in Caffe


@dataclass(frozen=True)
class PriorBoxParameter:
    """The ``prior_box_param { ... }`` block. Sizes and steps are in pixels of the image."""

    min_size: tuple[float, ...] = numbered(1, ())
    max_size: tuple[float, ...] = numbered(2, ())  # none, or one per min_size
    aspect_ratio: tuple[float, ...] = numbered(3, ())  # width / height
    flip: bool = numbered(4, True)  # also use the inverse ratios
    clip: bool = numbered(5, False)  # limit the boxes to the image
    # of x, y, width and height; or one for all; default 0.1
    variance: tuple[float, ...] = numbered(6, ())
    img_size: UInt | None = numbered(7, None)  # width and height of the image
    img_h: UInt | None = numbered(8, None)
    img_w: UInt | None = numbered(9, None)
    step: float | None = numbered(10, None)  # distance of the centres, in both directions
    step_h: float | None = numbered(11, None)
    step_w: float | None = numbered(12, None)
    offset: float = numbered(13, 0.5)  # of the centres, in steps


class PriorBox(ZeroGradient):
    """Boxes around every position of a map."""

    param: PriorBoxParameter
    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if not p.min_size or not all(size > 0 for size in p.min_size):
            raise self.fail(
                f"min_size {list(p.min_size)} must be one or more sizes above 0", "min_size"
            )
        are_larger = all(m < M for m, M in zip(p.min_size, p.max_size))
        if len(p.max_size) not in (0, len(p.min_size)) or not are_larger:
            raise self.fail(
                f"max_size {list(p.max_size)} must have a larger size for each min_size "
                f"{list(p.min_size)}, or none",
                "max_size",
            )
        if not all(ratio > 0 for ratio in p.aspect_ratio):
            raise self.fail(f"aspect_ratio {list(p.aspect_ratio)} must be above 0", "aspect_ratio")
        are_positive = all(variance > 0 for variance in p.variance)
        if len(p.variance) not in (0, 1, 4) or not are_positive:
            raise self.fail(
                f"variance {list(p.variance)} must be one or four numbers above 0", "variance"
            )
        self.image = self._pair("img_size", "img_h", "img_w")
        self.step = self._pair("step", "step_h", "step_w")

    def _pair(self, both: str, height: str, width: str) -> tuple[float, float] | None:
        """The values of an option for height and width; None if it is not given.

        Raises LayerError.
        """
        one, pair = (
            getattr(self.param, both),
            (getattr(self.param, height), getattr(self.param, width)),
        )
        if pair == (None, None):
            pair = (one, one)
        elif one is not None:
            raise self.fail(
                f"{both} and {height}, {width} are the same option; expected only one of them", both
            )
        if pair == (None, None):
            return None
        if not all(value is not None and value > 0 for value in pair):
            raise self.fail(f"expected {both}, or {height} and {width}, above 0")
        return pair

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for name, blob in list(zip(self.spec.bottom, bottom))[: 1 if self.image else 2]:
            if len(blob.shape) != 4 or 0 in blob.shape[2:]:
                raise self.fail(f"bottom {name!r} has shape {blob.shape}, expected (N, C, H, W)")
        H, W = bottom[0].shape[2:]
        top[0].reshape(1, 2, H * W * len(box_sizes(self.param)) * 4)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        image = self.image or bottom[1].shape[2:]
        boxes, variances = prior_boxes(self.param, bottom[0].shape[2:], image, self.step)
        top[0].data[0, 0], top[0].data[0, 1] = boxes.ravel(), variances.ravel()


def prior_boxes(
    p: PriorBoxParameter,
    map_size: Sequence[int],
    image: Sequence[float],
    step: tuple[float, float] | None,
) -> tuple[Array, Array]:
    """Return the boxes (H W P, 4) and their variances, of the same shape, in float64.

    Sizes and steps are (height, width); without ``step`` the centres are spread over the image.
    """
    (H, W), (height, width), sizes = map_size, image, np.array(box_sizes(p))
    step_h, step_w = step or (height / H, width / W)
    centre = np.empty((H, W, 1, 2))
    centre[..., 0] = ((np.arange(W) + p.offset) * step_w)[:, None]
    centre[..., 1] = ((np.arange(H) + p.offset) * step_h)[:, None, None]
    corners = np.concatenate([centre - sizes / 2, centre + sizes / 2], axis=-1)
    boxes = corners / (width, height, width, height)
    if p.clip:
        boxes = boxes.clip(0, 1)
    return boxes.reshape(-1, 4), np.broadcast_to(p.variance or 0.1, (boxes.size // 4, 4))


def box_sizes(p: PriorBoxParameter) -> list[tuple[float, float]]:
    """Return width and height in pixels of the P boxes at a position."""
    ratios = [1.0]
    for ratio in p.aspect_ratio:
        if all(abs(ratio - other) >= SAME for other in ratios):
            ratios += [ratio, 1 / ratio] if p.flip else [ratio]
    sizes = []
    for i, m in enumerate(p.min_size):
        sizes.append((m, m))
        if p.max_size:
            sizes.append((math.sqrt(m * p.max_size[i]),) * 2)
        sizes += [(m * math.sqrt(ratio), m / math.sqrt(ratio)) for ratio in ratios[1:]]
    return sizes
