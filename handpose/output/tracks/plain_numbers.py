"""Numbers as values of JSON and as fields of a table; unknown ones, which are not finite, are null
and empty.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from netlib.blob import Array


def rounded(numbers: ArrayLike, decimals: int) -> Any:
    """A number or lists of numbers; None for unknown ones."""
    if isinstance(numbers, float):  # the frequent case
        return round(float(numbers), decimals) + 0.0 if math.isfinite(numbers) else None
    array = np.asarray(numbers, dtype=np.float64)
    values = (array.round(decimals) + 0.0).tolist()  # + 0.0: no -0.0
    return values if np.isfinite(array).all() else _nulled(values)


def rounded_if_known(numbers: Array, decimals: int) -> Any:
    """``rounded``, but one None if any number is unknown."""
    return rounded(numbers, decimals) if np.isfinite(numbers).all() else None


def _nulled(values: Any) -> Any:
    if isinstance(values, list):
        return [_nulled(value) for value in values]
    return values if math.isfinite(values) else None


def fields_of(numbers: ArrayLike, decimals: int) -> list[str]:
    """The fields of a number, or of all numbers in an array."""
    each = np.asarray(numbers, dtype=np.float64).ravel().tolist()
    return [f"{number:.{decimals}f}" if math.isfinite(number) else "" for number in each]
