"""Checks of depth images passed from Python: arrays of numbers in mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from netlib.errors import DataError

NEAR_MM, FAR_MM = 20.0, 20_000.0  # no depth camera measures a whole image nearer or farther


class UnitError(DataError):
    """The depths cannot be in mm."""


def numbers(values: object, what: str, masked: float) -> NDArray[Any]:
    """An array of numbers, with ``masked`` in place of masked values. Raises DataError; ``what`` begins its message."""
    if not isinstance(values, np.ndarray):
        raise DataError(f"{what} is a {type(values).__name__}, expected an array of numbers")
    if values.dtype.kind not in "fiub":
        raise DataError(f"{what} is an array of {values.dtype}, expected numbers")
    return values.filled(masked) if isinstance(values, np.ma.MaskedArray) else values


def depth_image(depth: object) -> NDArray[Any]:
    """The image (height, width), 0 where it is masked. Raises DataError for anything else."""
    image = numbers(depth, "depth image", 0)
    if image.ndim != 2:
        raise DataError(f"depth image of shape {image.shape}, expected (height, width)")
    return image


def check_unit(image: NDArray[Any], farthest: float = FAR_MM) -> None:
    """Raise UnitError if all depths are negative, too small for mm, or beyond ``farthest``.

    Single negative depths are allowed: some drivers write -1 where there is no reading.
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
