r"""Phases: convolutions with dilation d and stride 1, computed as those of d d images
without dilation.

The outputs of every d-th row and column read every d-th row and column of the padded x. They are
the outputs of one image with adjacent windows, for which Winograd's algorithms take half of the
multiplications:

    images (n d d, C, Hp, Wp)        y (n d d, O, ceil(Ho / d), ceil(Wo / d)), whose last rows and
                                     columns may be unused
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from fast.fusing import After
from fast.geometry import MAX_EXCESS, Algorithm, Geometry, Sizes, Sum, check_finite, inside
from fast.parallel import scratch
from fast.row_winograd import TILE
from netlib.blob import Array, blocks

BLOCK_BYTES = 8 << 20  # of the images
MIN_OUTPUTS = 14  # along an axis of an image, which has kh - 1 more rows
MAX_WASTE = 1.25  # outputs in the tiles of all images, relative to those of y
MIN_WORK = 150  # multiplications for a value of x or y, so that copying takes little time
MIN_COST = 60_000_000  # multiplications, so that the calls take little time


class Phases(Algorithm):
    """The algorithm for images with dilation, by one of some algorithms for images without."""

    def __init__(self, algorithms: Sequence[Algorithm]) -> None:
        self.algorithms = algorithms

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Maps with enough outputs for each image, and for one of the algorithms.

        Up to twice as fast, as measured with 12 to 192 channels, maps of 27 to 80 pixels and
        dilations of 2 to 9.
        """
        g = s.geometry
        if (
            sum_ == "transpose"
            or len(s.sizes) != 2
            or set(g.stride) != {1}
            or s.excess > MAX_EXCESS
        ):
            return False
        waste = math.prod(-(-n // (d * TILE)) * d * TILE / n for n, d in zip(s.windows, g.dilation))
        if max(g.dilation) == 1 or waste > MAX_WASTE or min(_sizes(s).windows) < MIN_OUTPUTS:
            return False
        work = math.prod(g.kernel) * s.inputs * s.outputs
        if (
            work < MIN_WORK * (s.inputs + s.outputs)
            or s.images * math.prod(s.windows) * work < MIN_COST
        ):
            return False
        return any(one.fits(_sizes(s), sum_) for one in self.algorithms)

    def _algorithm(self, g: Geometry, x: Array, y: Array, sum_: Sum) -> Algorithm:
        """The first of the algorithms that fits the images of this batch."""
        s = _sizes(Sizes.of(g, x.shape, y.shape))
        return next(one for one in self.algorithms if one.fits(s, sum_))

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        algorithm = self._algorithm(g, x, y, "correlate")
        for part, images, out in _blocks(g, x, y):
            algorithm.correlate(_dense(g), images, w, after, out)
            for found, target in _outputs(g, out, y[part]):
                target[...] = found

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        algorithm, total = self._algorithm(g, x, dy, "gradient"), np.zeros_like(dw)
        for part, images, out in _blocks(g, x, dy):
            out.fill(0)
            for place, source in _outputs(g, out, dy[part]):
                place[...] = source
            algorithm.gradient(_dense(g), images, out, total)
        check_finite(total)  # an infinite value times the 0 of an unused output
        dw += total


def _dense(g: Geometry) -> Geometry:
    """Adjacent windows of images that contain their padding."""
    return Geometry(g.kernel, (1, 1), (0, 0), (1, 1), g.group)


def _sizes(s: Sizes) -> Sizes:
    """Those of the images."""
    outputs = tuple(-(-n // d) for n, d in zip(s.windows, s.geometry.dilation))
    sizes = tuple(n + k - 1 for n, k in zip(outputs, s.geometry.kernel))
    images = s.images * math.prod(s.geometry.dilation)
    return Sizes(_dense(s.geometry), images, s.inputs, sizes, s.outputs, outputs, s.excess)


def _blocks(g: Geometry, x: Array, y: Array) -> Iterator[tuple[slice, Array, Array]]:
    """Some images of the batch, theirs, (n d d, C, Hp, Wp), and memory for the outputs of these."""
    (N, C), (down, right), (top, left) = x.shape[:2], g.dilation, g.pad
    Ho, Wo = (-(-n // d) for n, d in zip(y.shape[2:], g.dilation))
    H, W = Ho + g.kernel[0] - 1, Wo + g.kernel[1] - 1
    for part in blocks(N, max(1, BLOCK_BYTES // max(down * right * C * H * W * x.itemsize, 1))):
        n = part.stop - part.start
        images = scratch("phases", (n, down, right, C, H, W), x.dtype)
        images.fill(0)
        for r, c in np.ndindex(down, right):
            row, rows = inside(r - top, down, x.shape[2], H)
            column, columns = inside(c - left, right, x.shape[3], W)
            source = x[part, :, row::down, column::right]
            images[:, r, c, :, rows, columns] = source[
                ..., : rows.stop - rows.start, : columns.stop - columns.start
            ]
        out = scratch("outputs of phases", (n * down * right, y.shape[1], Ho, Wo), y.dtype)
        yield part, images.reshape(-1, C, H, W), out


def _outputs(g: Geometry, out: Array, y: Array) -> Iterator[tuple[Array, Array]]:
    """The outputs of each phase in this memory and in y."""
    (down, right), phases = g.dilation, out.reshape(len(y), *g.dilation, *out.shape[1:])
    for r, c in np.ndindex(down, right):
        target = y[:, :, r::down, c::right]
        yield phases[:, r, c, :, : target.shape[2], : target.shape[3]], target
