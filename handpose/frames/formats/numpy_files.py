"""NumPy's files, read frame by frame: the header of an array, and .npz, a zip file of arrays."""

from __future__ import annotations

import contextlib
import io
import math
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.frames.raw import check_values
from netlib import files
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files.pictures import MAX_PIXELS

HEADER = 1 << 14  # maximum bytes of a header
READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}

SMALL = 1 << 24  # bytes; maximum size of the other arrays
PARAMETERS = "biufSUM"  # their kinds: numbers, texts and dates


@dataclass(frozen=True)
class Header:
    """The header of an array's file; the values begin at byte ``start``."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    start: int
    by_columns: bool = False

    @property
    def frame_bytes(self) -> int:
        """The number of bytes of one frame."""
        return math.prod(self.shape[-2:]) * self.dtype.itemsize

    def stack(self, where: str) -> tuple[int, int, int]:
        """Number of frames, height and width; one image is a stack, too. Raises DataError for other shapes."""
        if len(self.shape) not in (2, 3) or 0 in self.shape or math.prod(self.shape[-2:]) > MAX_PIXELS:
            raise DataError(f"{where}: an array of shape {self.shape}; expected (frames, height, width)")
        if self.by_columns:
            raise DataError(f"{where}: an array in Fortran's order; write it with numpy.ascontiguousarray")
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
    except MemoryError as error:
        raise DataError(f"{where}: no memory to read its header") from error
    except Exception as error:  # Python's parser may raise anything for a damaged header
        raise DataError(f"{where}: no array as NumPy writes it: {reason_of(error)[:200]}") from None
    if min(shape, default=0) < 0:
        raise DataError(f"{where}: an array of shape {shape}")
    return Header(tuple(shape), dtype, stream.tell(), by_columns and len([size for size in shape if size > 1]) > 1)


class NpzFile:
    """The arrays of an .npz file. Raises DataError, also while they are read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._opened() as archive:
            self._headers = {}
            for entry in archive.namelist():
                if entry.endswith(".npy"):
                    with archive.open(entry) as stream:
                        self._headers[entry[:-4]] = header_of(stream.read(HEADER), f"{path}: {entry[:-4]}")

    def stack(self) -> tuple[str, Header]:
        """The array called depth, otherwise the only one with three axes. Raises DataError."""
        stacks = [name for name, header in self._headers.items() if len(header.shape) == 3]
        name = "depth" if "depth" in self._headers else stacks[0] if len(stacks) == 1 else ""
        if not name:
            content = ", ".join(f"{name} {header.shape}" for name, header in self._headers.items())
            raise DataError(
                f"{self.path}: holds {content or 'nothing'}; expected an array depth (frames, height, width)"
            )
        return name, self._headers[name]

    def others(self) -> list[str]:
        """The names of all other arrays."""
        main, _ = self.stack()
        return [name for name in self._headers if name != main]

    def small(self) -> dict[str, NDArray[Any]]:
        """All other small arrays of numbers, texts and dates."""
        found = {}
        with self._opened() as archive:
            for name in self.others():
                header = self._headers[name]
                size = max(archive.getinfo(f"{name}.npy").file_size, math.prod(header.shape) * header.dtype.itemsize)
                if size <= SMALL and header.dtype.kind in PARAMETERS:
                    content = archive.read(f"{name}.npy")
                    found[name] = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
        return found

    def frames(self, name: str, header: Header) -> Iterator[NDArray[Any]]:
        """The frames of an array one by one."""
        with self._opened() as archive, archive.open(f"{name}.npy") as stream:
            _exactly(stream, header.start)
            for _ in range(header.stack(str(self.path))[0]):
                yield header.frame(_exactly(stream, header.frame_bytes))
            stream.read(1)  # the checksum is verified at the end

    @contextlib.contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        """The archive; any error within the block becomes a DataError."""
        with BufferedReader(files.opened(self.path, "the depth frames")) as stream:
            try:
                with zipfile.ZipFile(stream) as archive:
                    yield archive
            except NetlibError:
                raise
            except Exception as error:  # for a damaged archive its reader and the decoders may raise any exception
                system = system_error_of(error)
                why = "cannot read the depth frames" if system else "a damaged .npz file"
                raise DataError(f"{self.path}: {why}: {reason_of(system or error)[:200]}") from error


def _exactly(stream: IO[bytes], count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError("it ends within a frame")
    return content
