"""The random numbers of scenes, which are drawn together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.synthetic.scenes.directions import unit
from netlib.blob import Array
from netlib.proto.schema import Double


@dataclass(frozen=True)
class Range:
    """A ``name { low: L high: H }``: uniform between two numbers."""

    low: Double
    high: Double

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Numbers of a shape."""
        return rng.uniform(self.low, self.high, shape)


@dataclass(frozen=True)
class Sizes(Range):
    """The same for sizes and distances above 0: each doubling is as likely as the next."""

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Numbers of a shape."""
        return np.exp(rng.uniform(np.log(self.low), np.log(self.high), shape))


@dataclass(frozen=True)
class Draw:
    """Draws numbers for each of N = ``count`` scenes, or of what is in them: arrays (N, ...), whose
    other axes are the arguments ``shape``.
    """

    rng: np.random.Generator
    count: int

    def __call__(self, bounds: Range, *shape: int) -> Array:
        """Numbers of a range."""
        return bounds.draw(self.rng, (self.count, *shape))

    def between(self, low: float, high: float, *shape: int) -> Array:
        """Uniform numbers."""
        return self.rng.uniform(low, high, (self.count, *shape))

    def chance(self, share: float | Array) -> NDArray[np.bool_]:
        """True (N,) with this probability."""
        return self.rng.random(self.count) < share

    def normal(self, *shape: int) -> Array:
        """Numbers of mean 0 and deviation 1."""
        return self.rng.normal(size=(self.count, *shape))

    def direction(self) -> Array:
        """Directions (N, 3), uniform."""
        return unit(self.normal(3))

    def rotation(self, *shape: int) -> Array:
        """Rotation matrices (N, ..., 3, 3), uniform."""
        w, x, y, z = np.moveaxis(unit(self.normal(*shape, 4)), -1, 0)
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
