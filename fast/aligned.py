"""Arrays that start at a multiple of 64 bytes, the size of a cache line and of an AVX-512 register.

NumPy's start at a multiple of 16 bytes, where each load and store of a large register touches two lines: operations on
arrays in the cache take up to twice as long.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.system import memory

LINE = 64


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array of any values."""
    return _placed(np.empty(_bytes(shape, dtype), np.uint8), shape, dtype)


def zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array of zeros."""
    return _placed(np.zeros(_bytes(shape, dtype), np.uint8), shape, dtype)


def zeros_for_blob(shape: tuple[int, ...], dtype: DTypeLike, blob: object) -> NDArray[Any]:
    """An array of zeros for a blob. Raises OutOfMemoryError."""
    size = _bytes(shape, dtype)
    memory.check(size, f"for an array {shape}", blob)
    return _placed(memory.zeros((size,), np.uint8, blob), shape, dtype)


def _bytes(shape: tuple[int, ...], dtype: DTypeLike) -> int:
    return math.prod(shape) * np.dtype(dtype).itemsize + LINE


def _placed(memory: NDArray[np.uint8], shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    start = -int(memory.ctypes.data) % LINE
    return memory[start : start + memory.size - LINE].view(dtype).reshape(shape)
