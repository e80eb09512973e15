r"""Lens distortion, and depth images without it: everything after a recording sees with a pinhole camera.

With x, y the slopes of a ray (x right, y DOWN, at depth 1) and r² = x² + y², Brown and Conrady's lens shows it at

    x' = x q + 2 p1 x y + p2 (r² + 2 x²)        q = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
    y' = y q + 2 p2 x y + p1 (r² + 2 y²)

as OpenCV has it. An inverse lens (RealSense's coded light) gives the same formula from the picture to the ray.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handpose.facts.cameras import Camera
from netlib.blob import Array
from netlib.errors import DataError

COUNTS = (4, 5, 8)  # of coefficients
ITERATIONS = 30  # of the inverse; the step shrinks by a tenth or more each time for any lens that is sold
LARGEST_PX = 1e-2  # that the inverse may be off


@dataclass(frozen=True)
class Lens:
    """A lens.

    coefficients  k1 k2 p1 p2 [k3 [k4 k5 k6]], OpenCV's order; none is no distortion
    model         is the formula from the ray to the picture, or the inverse?
    """

    coefficients: tuple[float, ...] = ()
    model: Literal["brown_conrady", "inverse_brown_conrady"] = "brown_conrady"

    def __post_init__(self) -> None:
        if len(self.coefficients) not in (0, *COUNTS) or not np.isfinite(self.coefficients).all():
            raise DataError(f"distortion {self.coefficients}, expected {', '.join(map(str, COUNTS))} finite numbers: "
                            "k1 k2 p1 p2 [k3 [k4 k5 k6]]")  # fmt: skip

    @property
    def is_straight(self) -> bool:
        """Is there no distortion?"""
        return not any(self.coefficients)

    def distorted(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where in the picture, as slopes, rays of slopes x and y (y down) appear. Raises DataError."""
        if self.model == "brown_conrady":
            return self._formula(x, y)
        a, b = x, y
        for _ in range(ITERATIONS):
            u, v = self._formula(a, b)
            a, b = a + (x - u), b + (y - v)
        return a, b

    def _formula(self, x: Array, y: Array) -> tuple[Array, Array]:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * (8 - len(self.coefficients)))
        r = x * x + y * y
        q = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
        return x * q + 2 * p1 * x * y + p2 * (r + 2 * x * x), y * q + 2 * p2 * x * y + p1 * (r + 2 * y * y)


class Straightener:
    """Depth images of a camera behind a lens, as the camera alone would see them.

    By nearest neighbour: a mean of two depths at an edge would be a point in thin air. Pixels that the lens does not
    show are 0. Raises DataError for a lens that cannot be inverted over the picture.
    """

    def __init__(self, camera: Camera, lens: Lens) -> None:
        self.shape = (camera.height, camera.width)
        x = (np.arange(camera.width) - camera.u0) / camera.fx
        y = (np.arange(camera.height)[:, None] - camera.v0) / camera.fy
        x, y = np.broadcast_arrays(x, y)
        u, v = lens.distorted(x, y)
        if lens.model == "inverse_brown_conrady":
            off = np.hypot(*(a - b for a, b in zip(lens._formula(u, v), (x, y)))) * camera.fx
            if not (off < LARGEST_PX).all():
                raise DataError(f"distortion {lens.coefficients} cannot be inverted over the picture; check it")
        column, row = np.rint(u * camera.fx + camera.u0), np.rint(v * camera.fy + camera.v0)
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        self._source = np.where(inside, row * camera.width + column, 0).astype(np.int32)
        self._outside = ~inside

    def __call__(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The straight image (height, width) of one behind the lens."""
        straight = depth.reshape(-1).take(self._source)
        straight[self._outside] = 0
        return straight
