"""A depth image that somebody gives from Python: an array of numbers in mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from netlib.errors import DataError

NEAR_MM, FAR_MM = 20.0, 20_000.0  # no depth camera reads all of an image nearer, or farther


class UnitError(DataError):
    """Depths in another unit than mm."""


def numbers(values: object, what: str, masked: float) -> NDArray[Any]:
    """An array of numbers; ``masked`` stands where a mask hides one. Raises DataError, which begins with ``what``."""
    if not isinstance(values, np.ndarray):
        raise DataError(f"{what} is a {type(values).__name__}, expected an array of numbers")
    if values.dtype.kind not in "fiub":
        raise DataError(f"{what} is an array of {values.dtype}, expected numbers")
    return values.filled(masked) if isinstance(values, np.ma.MaskedArray) else values


def depth_image(depth: object) -> NDArray[Any]:
    """The image (height, width), 0 where it is masked. Raises DataError for what is none."""
    image = numbers(depth, "depth image", 0)
    if image.ndim != 2:
        raise DataError(f"depth image of shape {image.shape}, expected (height, width)")
    return image


def check_unit(image: NDArray[Any], farthest: float = FAR_MM) -> None:
    """Raise UnitError for an image whose depths are all too small, or beyond ``farthest``, for mm, or negative.

    Single ones may be: some drivers write -1 where nothing was read.
    """
    finite = np.isfinite(image)
    seen = image[finite & (image > 0)]
    if not len(seen):
        seen = image[finite & (image < -NEAR_MM)] if image.dtype.kind in "fi" else seen
    if not len(seen):
        return
    low, high = float(seen.min()), float(seen.max())
    if high < 0:
        raise UnitError(f"depths from {low:.6g} to {high:.6g}, expected mm, growing away from the camera")
    if high < NEAR_MM:
        raise UnitError(f"depths from {low:.3g} to {high:.3g}, expected mm; they may be metres")
    if low > farthest:
        raise UnitError(f"depths from {low:.6g} to {high:.6g}, expected mm, nearer than {FAR_MM:g}; check the unit")
