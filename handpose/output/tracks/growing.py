"""What writers of tracks share, and files that grow frame by frame and are valid however the program ends."""

from __future__ import annotations

import contextlib
import os
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Protocol, TypeVar

from handpose.tracking.track import TrackedFrame
from netlib.files import atomic

T = TypeVar("T", bound="TrackWriter")


class Pieces(Protocol):
    """Takes the pieces of an output within a block. Raises OSError."""

    def __enter__(self) -> object: ...

    def append(self, piece: bytes) -> None:
        """Add a piece."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None: ...


class TrackWriter(ABC):
    """Writes a track frame by frame. The files are valid after any end of its block. Raises OSError.

    files  written; complete after the block
    """

    def __init__(self, path: Path | None, pieces: Pieces) -> None:
        self.files, self._pieces = [path] if path else [], pieces

    def __enter__(self: T) -> T:
        self._pieces.__enter__()
        return self

    @abstractmethod
    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._pieces.__exit__(kind, error, where)


class GrowingFile:
    """A file of pieces, written next to ``path`` and renamed at the end of the block; raises OSError.

    After an exception in the block, such as Ctrl-C or a full disk, the complete pieces are kept; without any, the old
    file.

    head   first bytes
    tail   last bytes: they are written after every piece, and overwritten by the next, so that no failure truncates
           them
    shown  rename it after the first piece instead, so that other programs can read the pieces as they are written
    """

    def __init__(self, path: Path, head: bytes = b"", tail: bytes = b"", shown: bool = False) -> None:
        self.path, self._head, self._tail, self._shown = path, head, tail, shown
        self._end = 0  # offset of the next piece
        self._pieces = 0

    def __enter__(self) -> GrowingFile:
        with contextlib.ExitStack() as stack:
            stack.enter_context(atomic.error_names(self.path))
            atomic.require_regular_file(self.path)
            self._fresh = stack.enter_context(atomic.temporary(self.path))
            self._stream = stack.enter_context(self._fresh.open("wb", buffering=0))
            self._put(self._head)
            self._stack = stack.pop_all()
        return self

    def append(self, piece: bytes) -> None:
        """Add a piece."""
        with atomic.error_names(self.path):
            self._put(piece)
            if self._shown and not self._pieces:
                atomic.require_regular_file(self.path)
                atomic.commit(self._fresh, self.path, sync=False)
        self._pieces += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        with self._stack, atomic.error_names(self.path):
            if kind is None or self._pieces:
                self._finish(self._tail)

    def finish(self, tail: bytes) -> None:
        """Replace the last bytes, by no more than before; only at the end of the block."""
        self._tail = tail

    def _put(self, piece: bytes) -> None:
        try:
            self._write(piece + self._tail)
        except OSError:
            if self._shown and not self._tail:  # a reader must not find half a piece
                self._stream.truncate(self._end)
            raise
        self._end += len(piece)

    def _finish(self, tail: bytes) -> None:
        self._write(tail)
        self._stream.truncate(self._end + len(tail))
        if self._shown and self._pieces:
            os.fsync(self._stream.fileno())
        self._stream.close()
        if not (self._shown and self._pieces):
            atomic.commit(self._fresh, self.path)

    def _write(self, content: bytes) -> None:
        self._stream.seek(self._end)
        done = 0
        while done < len(content):
            done += self._stream.write(content[done:])
