"""Pinhole depth cameras: between pixels with a depth (u, v, d) and points (x, y, z).

u, v    pixels, v growing downwards; the pixel in row r and column c has its centre at u = c, v = r
d, z    millimetres along the optical axis (not along the ray)
x, y    millimetres, x to the right, y UP, z away from the camera

u = u0 + fx x / z        v = v0 - fy y / z        d = z

Lens distortion is not modelled: the data sets publish undistorted frames.

Readings nearer than a camera's minimum range are errors, such as reflections, and count as missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]  # depths, and crops of them

MIN_FOCAL_PX = 1e-6  # with less, points have no finite pixels
# default; the cameras named below, and most others, measure from 200 mm or farther
MIN_RANGE_MM = 200.0
FINDER_FOCAL_PX = 160.0  # focal length of the frames that the finder of hands sees


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Raises ValueError for focal lengths that are not positive, and for values not finite.
    """

    name: str
    fx: float  # focal lengths, pixels
    fy: float
    u0: float  # principal point, pixels
    v0: float
    width: int  # image size, pixels
    height: int
    min_range_mm: float = MIN_RANGE_MM  # nearer readings are errors

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "u0", "v0"):
            if not isinstance(getattr(self, name), Real):
                raise ValueError(
                    f"camera {self.name!r}: {name} is {getattr(self, name)!r}, expected a number"
                )
        for name in ("fx", "fy"):
            if not MIN_FOCAL_PX < getattr(self, name) < math.inf:
                raise ValueError(
                    f"camera {self.name!r}: {name} is {getattr(self, name)}, expected more than "
                    f"{MIN_FOCAL_PX:g} px"
                )
        for name in ("u0", "v0"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(
                    f"camera {self.name!r}: {name} is {getattr(self, name)}, expected a finite number of px"
                )

    def is_too_near(self, depth: NDArray[Any]) -> NDArray[np.bool_]:
        """True for readings of a depth image in mm that are nearer than the camera measures."""
        return (depth > 0) & (depth < self.min_range_mm)

    def in_range(self, depth: NDArray[Any]) -> NDArray[Any]:
        """A depth image in mm whose readings nearer than the minimum range are 0, which
        means no reading.
        """
        near = self.is_too_near(depth)
        return np.where(near, depth.dtype.type(0), depth) if near.any() else depth

    def has_pixel(self, column: NDArray[Any], row: NDArray[Any]) -> NDArray[np.bool_]:
        """True for columns and rows, of any shapes that broadcast, that are in the image."""
        in_width = (column >= 0) & (column < self.width)
        in_height = (row >= 0) & (row < self.height)
        return in_width & in_height

    def mirrored(self) -> Camera:
        """The camera of the mirror images of its frames, whose columns are in reverse order."""
        return replace(self, u0=self.width - 1 - self.u0)

    def project(self, xyz: ArrayLike) -> Array:
        """Points (..., 3) x, y, z in mm to (..., 3) u, v in pixels and d in mm."""
        x, y, z = np.moveaxis(np.asarray(xyz, dtype=np.float64), -1, 0)
        u = self.u0 + self.fx * x / z
        v = self.v0 - self.fy * y / z
        return np.stack([u, v, z], axis=-1)

    def unproject(self, uvd: ArrayLike) -> Array:
        """The inverse of ``project``."""
        u, v, d = np.moveaxis(np.asarray(uvd, dtype=np.float64), -1, 0)
        x = (u - self.u0) * d / self.fx
        y = (self.v0 - v) * d / self.fy
        return np.stack([x, y, d], axis=-1)


@dataclass(frozen=True)
class View:
    """A camera whose intrinsics follow from the size of its frames.

    at     the camera for a width and a height in px; raises DataError for a size that
           it cannot have
    sizes  all widths and heights that it can have, if they are known
    """

    name: str
    at: Callable[[int, int], Camera]
    sizes: tuple[tuple[int, int], ...] = ()


def by_field_of_view(
    name: str, horizontal: float, vertical: float | None = None, min_range_mm: float = MIN_RANGE_MM
) -> View:
    """A camera with a field of view in degrees, square pixels unless both are given, and its axis
    in the middle.
    """

    def at(width: int, height: int) -> Camera:
        fx = width / 2 / math.tan(math.radians(horizontal) / 2)
        fy = fx if vertical is None else height / 2 / math.tan(math.radians(vertical) / 2)
        return Camera(name, fx, fy, (width - 1) / 2, (height - 1) / 2, width, height, min_range_mm)

    return View(name, at)


def _model(
    name: str, degrees: dict[tuple[int, int], float], min_range_mm: float = MIN_RANGE_MM
) -> View:
    """A model of camera, with its horizontal field of view for frames of each shape."""

    def at(width: int, height: int) -> Camera:
        for (w, h), horizontal in degrees.items():
            if abs(width * h - height * w) <= SAME_SHAPE * height * w:
                return by_field_of_view(name, horizontal, None, min_range_mm).at(width, height)
        shapes = ", ".join(f"{w}:{h}" for w, h in degrees)
        from netlib.errors import DataError  # imported here, because a camera needs NumPy alone

        raise DataError(
            f"frames of {width} x {height} px; depth frames of {name} are {shapes}; if they are cut or "
            "turned, give --camera FX,FY,U0,V0"
        )

    return View(name, at)


SAME_SHAPE = 0.02  # tolerance of a ratio of width and height; 848 x 480 px count as 16:9
NYU = Camera("nyu", 588.03, 587.07, 320.0, 240.0, 640, 480)
ICVL = Camera("icvl", 240.99, 240.96, 160.0, 120.0, 320, 240)
MSRA15 = Camera("msra15", 241.42, 241.42, 160.0, 120.0, 320, 240)
KINECT2 = Camera("kinect2", 363.9, 363.9, 255.4, 206.3, 512, 424)
SR305 = Camera("sr305", 476.007, 476.007, 313.68, 242.76, 640, 480)

CAMERAS = {camera.name: camera for camera in (NYU, ICVL, MSRA15, KINECT2, SR305)}
# Models, by the field of view in degrees that corresponds to their usual focal length in frames of
# each shape: factory calibrations of single cameras differ by some 3%. Data sheets of stereo
# cameras subtract what one imager does not see.
VIEWS = {
    view.name: view
    for view in (
        _model("d405", {(16, 9): 89.0, (4, 3): 78.5, (16, 10): 89.0}, 70.0),
        _model("d415", {(16, 9): 69.4, (4, 3): 54.9}),
        _model("d435", {(16, 9): 90.0, (4, 3): 79.6, (16, 10): 90.0}),
        _model("d455", {(16, 9): 90.0, (4, 3): 79.6, (16, 10): 90.0}),
        _model("azure", {(10, 9): 64.8, (1, 1): 90.9}),
        _model("femto", {(10, 9): 64.8, (1, 1): 90.9}),
        _model("kinect1", {(4, 3): 58.1}),
    )
}
UNIT_MM = {"sr305": 0.125}  # depth unit of the cameras' images, where it is not 1 mm
