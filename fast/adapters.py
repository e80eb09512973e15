"""Adapters of algorithms for convolutions: for several groups, for dx, and for values that are not finite."""

from __future__ import annotations

from collections.abc import Iterator

from fast.columns import Columns
from fast.fusing import After
from fast.geometry import Algorithm, Geometry, NotFiniteError, Sizes, Sum, check_finite
from netlib.blob import Array
from netlib.system.memory import blocks


class ByGroup(Algorithm):
    """Runs an algorithm for one group on each of one or several groups."""

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether the algorithm fits one group."""
        return self.algorithm.fits(s.one_group, sum_)

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        for i, o in _channels(g, x, y):
            self.algorithm.correlate(g.one_group, x[:, i], w[o], after.part(o), y[:, o])

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        for i, o in _channels(g, x, dy):
            self.algorithm.gradient(g.one_group, x[:, i], dy[:, o], dw[o])


def _channels(g: Geometry, x: Array, y: Array) -> Iterator[tuple[slice, slice]]:
    """The channels of x and of y of each group."""
    return zip(blocks(x.shape[1], x.shape[1] // g.group), blocks(y.shape[1], y.shape[1] // g.group))


class Turned(Algorithm):
    """Computes dx as the convolution of dy with the flipped kernel."""

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether there is such a convolution, and the algorithm fits it."""
        return sum_ == "transpose" and s.turned is not None and self.algorithm.fits(s.turned, "correlate")

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx. An infinite weight times the padding of dy is NaN where no window has that weight."""
        try:
            check_finite(w)
        except NotFiniteError:
            Columns().transpose(g, dy, w, after, dx)
        else:
            self.algorithm.correlate(g.turned, dy, g.flipped(w), after, dx)


class Contained(Algorithm):
    """Keeps an infinite value or NaN in its windows: runs an algorithm that mixes the values of several windows and,
    where it finds such a value, which may also be an overflow in a transform, Columns."""

    def __init__(self, algorithm: Algorithm) -> None:
        self.algorithm = algorithm

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Whether the algorithm fits."""
        return self.algorithm.fits(s, sum_)

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        try:
            self.algorithm.correlate(g, x, w, after, y)
        except NotFiniteError:
            Columns().correlate(g, x, w, after, y)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        try:
            self.algorithm.gradient(g, x, dy, dw)
        except NotFiniteError:
            Columns().gradient(g, x, dy, dw)
