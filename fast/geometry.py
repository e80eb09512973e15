"""What the algorithms for convolutions share: sizes of windows, division of a batch into blocks,
parts of a product.

There are three sums on arrays x (N, C, ...) and y (N, O, ...), with w (O, C / group, ...):

    correlate   y  = sum of w x, for a convolution's forward         (backward of a deconvolution)
    transpose   dx = every dy w, added at the position of its x      (forward of a deconvolution)
    gradient    dw = sum over images and windows of dy x, added to dw

The method ``fits`` of an algorithm is the only place that states which of them it computes
for which sizes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np

from fast import parallel
from fast.fusing import After
from fast.parallel import equal_blocks
from netlib.blob import Array, blocks, divide_up

Sum = Literal["correlate", "transpose", "gradient"]

# Rows of a part: a multiple of those that BLAS computes together, so that all parts round alike.
MIN_PART = 32
# Multiplications of a product that is divided into parts; a smaller one takes less time than a
# virtual processor needs to wake a thread.
MIN_PARTS_COST = 10_000_000
# Multiplications of a block, on average, from which blocks run on several threads.
MIN_BLOCK_COST = 5_000_000
# Excess (see Sizes) from which a convolution with the flipped kernel takes longer than adding
# columns.
MAX_EXCESS = 1.3
# Largest value relative to usual ones; its rounding errors are 5e-4 of usual neighbouring outputs.
MAX_OUTLIER = 4000.0
SAMPLED_VALUES = 256  # for an estimate of the usual values
# First quartile of |z| for a standard normal z.
NORMAL_QUARTILE = 0.3186


@dataclass(frozen=True)
class Geometry:
    """Kernel, stride, pad and dilation of a convolution, one number per spatial axis, and the
    number of groups.
    """

    kernel: tuple[int, ...]
    stride: tuple[int, ...]
    pad: tuple[int, ...]
    dilation: tuple[int, ...]
    group: int

    @cached_property
    def is_dense(self) -> bool:
        """Whether neighbouring windows are one value apart and read neighbouring values."""
        return set(self.stride) | set(self.dilation) == {1}

    @cached_property
    def is_pointwise(self) -> bool:
        """Whether x itself is its columns, without a stride."""
        return set(self.kernel) == {1} and not any(self.pad)

    @cached_property
    def one_group(self) -> Geometry:
        """The geometry of one of the groups."""
        return Geometry(self.kernel, self.stride, self.pad, self.dilation, 1)

    @cached_property
    def reach(self) -> tuple[int, ...]:
        """The distance between the first and the last value of a window, on each axis."""
        return tuple(d * (k - 1) for k, d in zip(self.kernel, self.dilation))

    @cached_property
    def turned(self) -> Geometry:
        """The geometry of the transpose of a convolution with stride 1: a convolution with the
        flipped kernel.
        """
        pad = tuple(reach - p for reach, p in zip(self.reach, self.pad))
        return Geometry(self.kernel, self.stride, pad, self.dilation, self.group)

    def flipped(self, w: Array) -> Array:
        """The kernel of the transpose of a convolution with stride 1, (C, O / group, ...)."""
        by_group = w.reshape(self.group, len(w) // self.group, *w.shape[1:]).swapaxes(1, 2)
        by_channel = by_group.reshape(-1, *by_group.shape[2:]) if self.group > 1 else by_group[0]
        backwards = (slice(None, None, -1),) * len(self.kernel)
        return by_channel[(...,) + backwards]

    def padded(self, sizes: Sequence[int]) -> tuple[int, ...]:
        """The spatial axes with their padding."""
        return tuple(n + 2 * p for n, p in zip(sizes, self.pad))

    def extent(self, windows: Sequence[int]) -> tuple[int, ...]:
        """How many values these numbers of neighbouring windows span on each axis."""
        axes = zip(windows, self.stride, self.reach)
        return tuple((n - 1) * s + reach + 1 for n, s, reach in axes)

    def unpadded(self, sizes: Sequence[int]) -> tuple[slice, ...]:
        """The part of padded axes that is not padding."""
        return tuple(slice(p, p + n) for n, p in zip(sizes, self.pad))

    def under_elements(
        self, rows: slice, outputs: Sequence[int]
    ) -> Iterator[tuple[tuple[int, ...], tuple[slice, ...]]]:
        """For each kernel element, the part of the padded axes under it in all windows of these
        rows of outputs.
        """
        counts = rows.stop - rows.start, *outputs[1:]
        lengths = [n * s for n, s in zip(counts, self.stride)]
        for element in np.ndindex(self.kernel):
            firsts = [i * d for i, d in zip(element, self.dilation)]
            firsts[0] += rows.start * self.stride[0]
            axes = zip(firsts, lengths, self.stride)
            yield element, tuple(slice(f, f + length, s) for f, length, s in axes)


@dataclass(frozen=True)
class Sizes:
    """Sizes of a sum over windows: x (images, inputs, \\*sizes) and y
    (images, outputs, \\*windows), for one group.

    excess  multiplications relative to those of y, for dx as a convolution with the flipped
            kernel; else 1
    """

    geometry: Geometry
    images: int
    inputs: int
    sizes: tuple[int, ...]
    outputs: int
    windows: tuple[int, ...]
    excess: float = 1.0

    @classmethod
    def of(cls, g: Geometry, x: tuple[int, ...], y: tuple[int, ...]) -> Sizes:
        """The sizes for arrays x (N, C, ...) and y (N, O, ...)."""
        inputs = x[1] // g.group
        outputs = y[1] // g.group
        return cls(g, x[0], inputs, x[2:], outputs, y[2:])

    @property
    def one_group(self) -> Sizes:
        """The sizes of one of the groups."""
        return replace(self, geometry=self.geometry.one_group)

    @property
    def turned(self) -> Sizes | None:
        """The sizes of the convolution with the flipped kernel that computes dx; None if
        there is none.
        """
        g = self.geometry.turned
        if set(g.stride) != {1} or min(g.pad) < 0:
            return None
        excess = math.prod(self.sizes) / max(math.prod(self.windows), 1)
        return Sizes(g, self.images, self.outputs, self.windows, self.inputs, self.sizes, excess)


def places_inside(start: int, step: int, size: int, count: int) -> tuple[int, slice]:
    """Of ``count`` places from ``start`` in steps, the first inside an axis, and the numbers of
    those that are.
    """
    places_before = divide_up(-start, step), divide_up(size - start, step)  # both ends of the axis
    first, end = (min(max(places, 0), count) for places in places_before)
    return max(start + first * step, 0), slice(first, max(end, first))


class Algorithm:
    """Base class: an algorithm overrides ``fits`` and the sums that ``fits`` accepts."""

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether the algorithm computes this sum for these sizes, and faster than those behind
        it in the table.
        """
        raise NotImplementedError

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        raise NotImplementedError

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx; ``after`` is for C outputs."""
        raise NotImplementedError

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        raise NotImplementedError


class NotFiniteError(Exception):
    """An algorithm that mixes the values of several windows has found one that is not finite,
    or much larger.
    """


def check_finite(values: Array) -> None:
    """Raise NotFiniteError if a value is infinite or NaN, or if the sum of the squares overflows.

    The product reads the values once, and in an array that was just written they are in the cache.
    """
    if not math.isfinite(np.vdot(values, values)):
        raise NotFiniteError


def check_spread(sums: Array, x: Array, outputs: int) -> None:
    """Raise NotFiniteError if the rounding errors of one value of x may be visible in outputs that
    do not contain it.

    sums     outputs of the windows of a block, before anything is added
    x        (n, C, ...) the images of the block
    outputs  per image and window

    One value that is v times as large as the usual ones adds v² outputs / C usual squares to the
    sum of squares. If that is suspicious, the values of x decide.
    """
    squares = float(np.vdot(sums, sums))
    if not math.isfinite(squares):
        raise NotFiniteError
    usual = _usual(sums)
    if not usual:
        return
    added_squares = squares / usual / usual - sums.size  # in units of usual squares
    is_suspicious = added_squares * x.shape[1] > MAX_OUTLIER**2 * outputs
    if is_suspicious and max(x.max(), -x.min()) > MAX_OUTLIER * _usual(x):
        raise NotFiniteError


def _usual(values: Array) -> float:
    """An estimate of the standard deviation, which few large values do not change.

    Zeros are those of a background.
    """
    step = max(values.size // SAMPLED_VALUES, 1) | 1  # odd, unlike most widths of images
    sample = np.abs(values.reshape(-1)[::step])
    sample = sample[sample > 0]
    if not sample.size:
        return 0.0
    quarter = sample.size // 4
    return float(np.partition(sample, quarter)[quarter]) / NORMAL_QUARTILE


def run_parts(job: Callable[[slice], None], channels: int, group: int, cost: float) -> None:
    """Call ``job`` for parts of the channels of a product with ``cost`` multiplications, one
    for each thread.

    A product inside a slice of the batch is one part, because other threads have other slices. A
    part has whole groups if there are several.
    """
    unit = MIN_PART if group == 1 else channels // group
    if cost < MIN_PARTS_COST or channels <= unit or parallel.is_inside():
        job(slice(0, channels))
    else:
        units = divide_up(channels, unit)
        part_channels = divide_up(units, parallel.threads()) * unit
        parallel.run([partial(job, part) for part in blocks(channels, part_channels)])


def run_blocks(
    job: Callable[[slice, slice], None], parts: Iterator[tuple[slice, slice]], cost: float
) -> None:
    """Call ``job`` for independent blocks of images and rows with together ``cost``
    multiplications.

    Several expensive blocks run on several threads; otherwise each may divide its
    channels between them.
    """
    jobs = [partial(job, *part) for part in parts]
    parallel.run(jobs, here=cost < len(jobs) * MIN_BLOCK_COST)


def image_blocks(
    images: int, outputs: Sequence[int], columns: int
) -> Iterator[tuple[slice, slice]]:
    """Divide a batch into blocks of about ``columns`` windows: several images, or some
    rows of one image.
    """
    rows = outputs[0]
    windows = math.prod(outputs)
    images_each = columns // max(windows, 1)
    if images_each:
        for block in equal_blocks(images, divide_up(images, images_each)):
            yield block, slice(0, rows)
        return
    bands = equal_blocks(rows, divide_up(windows, columns))
    for n in range(images):
        for band in bands:
            yield slice(n, n + 1), band
