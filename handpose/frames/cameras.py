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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MIN_RANGE_MM = 200.0  # default; the cameras named below, and most others, measure from 200 mm or farther


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Raises ValueError for focal lengths that are not positive, and for values not finite."""

    name: str
    fx: float  # focal lengths, pixels
    fy: float
    u0: float  # principal point, pixels
    v0: float
    width: int  # image size, pixels
    height: int
    min_range_mm: float = MIN_RANGE_MM  # nearer readings are errors

    def __post_init__(self) -> None:
        for name in ("fx", "fy"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"camera {self.name!r}: {name} is {getattr(self, name)}, expected more than 0 px")
        for name in ("u0", "v0"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(
                    f"camera {self.name!r}: {name} is {getattr(self, name)}, expected a finite number of px"
                )

    def is_too_near(self, depth: NDArray[Any]) -> NDArray[np.bool_]:
        """True for readings of a depth image in mm that are nearer than the camera measures."""
        return np.asarray((depth > 0) & (depth < self.min_range_mm))

    def in_range(self, depth: NDArray[Any]) -> NDArray[Any]:
        """A depth image in mm whose readings nearer than the minimum range are 0, which means no reading."""
        near = self.is_too_near(depth)
        return np.where(near, depth.dtype.type(0), depth) if near.any() else depth

    def project(self, xyz: ArrayLike) -> Array:
        """Points (..., 3) x, y, z in mm to (..., 3) u, v in pixels and d in mm."""
        x, y, z = np.moveaxis(np.asarray(xyz, dtype=np.float64), -1, 0)
        return np.stack([self.u0 + self.fx * x / z, self.v0 - self.fy * y / z, z], axis=-1)

    def unproject(self, uvd: ArrayLike) -> Array:
        """The inverse of ``project``."""
        u, v, d = np.moveaxis(np.asarray(uvd, dtype=np.float64), -1, 0)
        return np.stack([(u - self.u0) * d / self.fx, (self.v0 - v) * d / self.fy, d], axis=-1)


NYU = Camera("nyu", 588.03, 587.07, 320.0, 240.0, 640, 480)
ICVL = Camera("icvl", 240.99, 240.96, 160.0, 120.0, 320, 240)
MSRA15 = Camera("msra15", 241.42, 241.42, 160.0, 120.0, 320, 240)
KINECT2 = Camera("kinect2", 363.9, 363.9, 255.4, 206.3, 512, 424)
SR305 = Camera("sr305", 476.007, 476.007, 313.68, 242.76, 640, 480)

CAMERAS = {camera.name: camera for camera in (NYU, ICVL, MSRA15, KINECT2, SR305)}
UNIT_MM = {"sr305": 0.125}  # depth unit of the cameras' images, where it is not 1 mm
