"""The header of NumPy's files, for reading frames one by one."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.sources.raw import check_values
from netlib.errors import DataError, reason_of
from netlib.files.pictures import MAX_PIXELS

HEADER = 1 << 14  # maximum bytes of a header
READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


@dataclass(frozen=True)
class Header:
    """The header of an array's file; the values begin at byte ``start``."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    start: int

    @property
    def frame_bytes(self) -> int:
        """The number of bytes of one frame."""
        return math.prod(self.shape[-2:]) * self.dtype.itemsize

    def stack(self, where: str) -> tuple[int, int, int]:
        """Number of frames, height and width; one image is a stack, too. Raises DataError for other shapes."""
        if len(self.shape) not in (2, 3) or 0 in self.shape or math.prod(self.shape[-2:]) > MAX_PIXELS:
            raise DataError(f"{where}: an array of shape {self.shape}; expected (frames, height, width)")
        check_values(self.dtype, where)
        frames, height, width = (1,) * (3 - len(self.shape)) + self.shape
        return frames, height, width

    def frame(self, content: bytes) -> NDArray[Any]:
        """The frame with these bytes."""
        return np.frombuffer(content, self.dtype).reshape(self.shape[-2:])


def header_of(start: bytes, where: str) -> Header:
    """The header in the first bytes of a file. Raises DataError."""
    stream = io.BytesIO(start)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # headers written by Python 2
            version = npy.read_magic(stream)
            if version not in READERS:
                raise ValueError(f"its version is {version[0]}.{version[1]}")
            shape, by_columns, dtype = READERS[version](stream)
    except Exception as error:  # Python's parser may raise anything for a damaged header
        raise DataError(f"{where}: no array as NumPy writes it: {reason_of(error)[:200]}") from None
    if by_columns and len([size for size in shape if size > 1]) > 1:
        raise DataError(f"{where}: an array in Fortran's order; write it with numpy.ascontiguousarray")
    if min(shape, default=0) < 0:
        raise DataError(f"{where}: an array of shape {shape}")
    return Header(tuple(shape), dtype, stream.tell())
