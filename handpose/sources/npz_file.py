"""NumPy's .npz: a zip file of arrays, one of which is read frame by frame."""

from __future__ import annotations

import contextlib
import io
import math
import zipfile
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from handpose.sources.npy_header import HEADER, Header, header_of
from netlib import files
from netlib.errors import DataError, NetlibError, reason_of

SMALL = 1 << 24  # bytes; maximum size of the other arrays


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

    def small(self) -> dict[str, NDArray[Any]]:
        """All other small arrays of numbers and texts."""
        found = {}
        main, _ = self.stack()
        with self._opened() as archive:
            for name, header in self._headers.items():
                size = max(archive.getinfo(f"{name}.npy").file_size, math.prod(header.shape) * header.dtype.itemsize)
                if name != main and size <= SMALL and header.dtype.kind in "iufSU":
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
                raise DataError(f"{self.path}: a damaged .npz file: {reason_of(error)[:200]}") from None


def _exactly(stream: IO[bytes], count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError("it ends within a frame")
    return content
