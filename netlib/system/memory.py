"""Memory checks before allocation.

Operating systems overcommit memory and kill processes that use it. Requests that certainly
cannot fit, because they are larger than the machine's memory, are therefore rejected. Other
requests are tried.
"""

from __future__ import annotations

import functools
import math
import os
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.errors import LayerError

UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


class OutOfMemoryError(LayerError, MemoryError):
    """A request for more memory than there is."""


@functools.cache
def physical() -> float:
    """Memory of this machine in bytes; infinite if unknown."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # no POSIX system
        return math.inf


def check(size: int, what: str) -> None:
    """Raise OutOfMemoryError if ``size`` bytes cannot fit.

    ``what`` is their purpose, for example "for parameters".
    """
    if size > physical():
        raise OutOfMemoryError(
            f"{format_bytes(size)} {what}; this machine has {format_bytes(int(physical()))}"
        )


def zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Allocate an array of zeros. Raises OutOfMemoryError."""
    check(math.prod(shape) * np.dtype(dtype).itemsize, f"for an array {shape}")
    return np.zeros(shape, dtype)


def is_lacking(error: Exception) -> bool:
    """Whether an error reports a lack of memory; NumPy raises ValueError for arrays beyond any
    address space, OpenCV its own error.
    """
    begins = ("array is too big", "Maximum allowed dimension", "std::bad_alloc")
    return (
        isinstance(error, MemoryError)
        or str(error).startswith(begins)
        or "Insufficient memory" in str(error)
    )


def format_bytes(size: int) -> str:
    """Format as ``20 GB`` or ``8.6 TB``: two significant digits, or whole numbers from 10 on."""
    number = float(size)
    unit = 0
    while round(number) >= 1000 and unit < len(UNITS) - 1:
        number /= 1000
        unit += 1
    digits = 1 if unit and number < 9.95 else 0
    return f"{number:.{digits}f} {UNITS[unit]}"
