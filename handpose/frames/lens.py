"""Lens distortion, and its removal from depth images: all other code sees a pinhole camera.

With x, y the slopes of a ray (x right, y DOWN, at depth 1) and r² = x² + y², the Brown-Conrady
model maps it to

    x' = x q + 2 p1 x y + p2 (r² + 2 x²)
    q = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
    y' = y q + 2 p2 x y + p1 (r² + 2 y²)

as in OpenCV. An inverse lens (RealSense's coded light) has the same formula from the
image to the ray.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from netlib.blob import Array
from netlib.errors import DataError, did_you_mean
from netlib.files.reading import located

COUNTS = (4, 5, 8)  # allowed numbers of coefficients
INVERSE_ITERATIONS = 30  # of a fixed point, whose steps at least halve for any real lens
MAX_SLOPE_ERROR = 1e-5  # maximum error of the inverse; 0.01 px for a focal length of 1,000 px
RADII = 4096  # number of radii, from the middle to the corner, at which a fold is looked for
MIN_SHOWN = 0.25  # minimum share of the image that remains; with less, the coefficients are wrong

# Names of the models, in lower case and with single spaces. RealSense uses "modified Brown
# Conrady" for colour cameras, which is not supported; nor are fisheye models, because depth
# cameras do not use them.
FORWARD = {
    "brown conrady",
    "plumb bob",
    "rational polynomial",
    "opencv",
    "radtan",
    "radial tangential",
}
INVERSE = {"inverse brown conrady"}
LensModel = Literal["brown_conrady", "inverse_brown_conrady"]
NONE = {"none", ""}


@dataclass(frozen=True)
class Lens:
    """A lens.

    coefficients  k1 k2 p1 p2 [k3 [k4 k5 k6]], OpenCV's order; empty without distortion
    model         direction of the formula: from the ray to the image, or the inverse
    """

    coefficients: tuple[float, ...] = ()
    model: LensModel = "brown_conrady"

    def __post_init__(self) -> None:
        if self.model not in (known := get_args(LensModel)):
            raise DataError(f"lens model {self.model!r}, expected {' or '.join(known)}")
        if len(self.coefficients) not in (0, *COUNTS) or not np.isfinite(self.coefficients).all():
            raise DataError(
                f"distortion {self.coefficients}, expected {', '.join(map(str, COUNTS))} finite numbers: "
                "k1 k2 p1 p2 [k3 [k4 k5 k6]]"
            )

    @property
    def is_straight(self) -> bool:
        """True without distortion."""
        return not any(self.coefficients)

    def distorted(self, x: Array, y: Array) -> tuple[Array, Array]:
        """The slopes in the image of rays of slopes x and y (y down); NaN for rays
        outside the image.

        Raises DataError for an inverse lens that cannot be inverted there.
        """
        with np.errstate(all="ignore"):
            if self.model == "inverse_brown_conrady":
                return self._inverse_formula(x, y)
            u, v = self._formula(x, y)
            r = np.hypot(x, y)
            folded = r >= self._fold(float(r.max(initial=0)))
            return np.where(folded, np.nan, u), np.where(folded, np.nan, v)

    def _fold(self, max_radius: float) -> float:
        """The radius beyond which the formula folds back towards the middle; no light arrives
        from there. Infinite without a fold up to ``max_radius``.
        """
        r = np.linspace(0, max_radius, RADII)
        k1, k2, _, _, *others = self.coefficients or (0.0,) * 4
        radial = replace(self, coefficients=(k1, k2, 0.0, 0.0, *others))
        distorted, _ = radial._formula(r, np.zeros_like(r))
        falls = ~(np.diff(distorted) > 0)
        return float(r[np.argmax(falls)]) if max_radius and falls.any() else np.inf

    def _formula(self, x: Array, y: Array) -> tuple[Array, Array]:
        """The slopes x' and y' of the module's docstring."""
        missing = max(COUNTS) - len(self.coefficients)
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * missing)
        r2 = x * x + y * y
        numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        q = numerator / denominator
        u = x * q + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * q + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return u, v

    def _inverse_formula(self, u: Array, v: Array) -> tuple[Array, Array]:
        """The slopes x and y that the formula maps to u and v. Raises DataError."""
        x, y = u, v
        for _ in range(INVERSE_ITERATIONS):
            mapped_x, mapped_y = self._formula(x, y)
            x, y = x + (u - mapped_x), y + (v - mapped_y)
        mapped_x, mapped_y = self._formula(x, y)
        if not (np.hypot(mapped_x - u, mapped_y - v) < MAX_SLOPE_ERROR).all():
            raise DataError(
                f"distortion {self.coefficients} cannot be inverted over the picture; check it"
            )
        return x, y


def lens_of(model: str, coefficients: Sequence[float], where: str) -> Lens:
    """The lens for a model name of RealSense, ROS or OpenCV. Raises DataError for other names."""
    name = " ".join(re.split(r"[\W_]+", model.lower().removeprefix("distortion.").strip()))
    numbers = tuple(float(number) for number in coefficients)
    if not any(numbers):
        return Lens()
    if name in NONE:
        raise DataError(f"{where}: distortion {numbers} of the model {model!r}, which has none")
    if name not in FORWARD | INVERSE:
        advice = did_you_mean(name, FORWARD | INVERSE)
        raise DataError(
            f"{where}: distortion model {model!r} is not known{advice}; known: brown_conrady (OpenCV's), "
            "inverse_brown_conrady (RealSense's coded light), none"
        )
    while len(numbers) > max(COUNTS) and not numbers[-1]:  # OpenCV's thin prisms and tilted sensors
        numbers = numbers[:-1]
    with located(where):
        return Lens(numbers, "inverse_brown_conrady" if name in INVERSE else "brown_conrady")


class Undistorter:
    """Undistorts depth images.

    By nearest neighbour, because the mean of two depths at an edge would be a point in empty space.
    Pixels outside the lens's view are 0. Raises DataError for a lens that cannot be inverted over
    the image, or that leaves little of it.
    """

    def __init__(self, camera: Camera, lens: Lens) -> None:
        with np.errstate(all="ignore"):  # the numbers may be arbitrary
            x = (np.arange(camera.width) - camera.u0) / camera.fx
            y = (np.arange(camera.height)[:, None] - camera.v0) / camera.fy
            u, v = lens.distorted(*np.broadcast_arrays(x, y))
            column = np.rint(u * camera.fx + camera.u0)
            row = np.rint(v * camera.fy + camera.v0)
            inside = camera.has_pixel(column, row)
            self._source = np.where(inside, row * camera.width + column, 0).astype(np.int32)
        if inside.mean() < MIN_SHOWN:
            raise DataError(
                f"distortion {lens.coefficients} leaves {inside.mean():.0%} of the picture; check it"
            )
        self._outside = ~inside

    def __call__(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The undistorted image (height, width)."""
        straight = depth.reshape(-1).take(self._source)
        straight[self._outside] = 0
        return straight
