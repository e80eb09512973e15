"""Writers of tracks, by the ending of a name; their files are complete however the program ends.

with open_writer("wave.json", header) as writer:
    for frame in frames:
        writer.write(frame)
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from handpose.body.gestures import GestureReader
from handpose.body.joint_formats.formats import FormatName
from handpose.output.tracks.csv_file import HandColumns, known, rows_of
from handpose.output.tracks.json_values import FrameValues, header_values
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from netlib.errors import DataError
from netlib.files import atomic

T = TypeVar("T", bound="GrowingFile")
_text = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode  # ASCII only


class GrowingFile:
    """A file of pieces, written next to ``path`` and renamed at the end of the block; raises OSError.

    After an exception in the block, such as Ctrl-C or a full disk, the complete pieces are kept; without any, the old
    file.

    path  None: standard output, to which each piece is written at once
    head  first bytes
    tail  last bytes: they are written after every piece, and overwritten by the next, so that no failure truncates them
    end   replaces ``tail`` at the end of a block without an exception; not longer
    shown  rename it after the first piece instead, so that the others can be read as they are written
    """

    def __init__(
        self, path: Path | None, head: bytes = b"", tail: bytes = b"", end: bytes | None = None, shown: bool = False
    ) -> None:
        self.path, self._head, self._tail, self._shown = path, head, tail, shown
        self._end = tail if end is None else end
        self._offset = 0  # of the next piece
        self._pieces = 0

    def __enter__(self: T) -> T:
        if self.path is None:
            self.append(self._head)
            return self
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
        if self.path is not None:
            with atomic.error_names(self.path):
                self._put(piece)
                if self._shown and not self._pieces:
                    atomic.commit(self._fresh, self.path, sync=False)
        elif sys.stdout is None:  # a shell closed it
            raise OSError(errno.EBADF, "is closed", "standard output")
        else:
            sys.stdout.write(piece.decode("ascii"))
            sys.stdout.flush()
        self._pieces += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self.path is None:
            return
        with self._stack, atomic.error_names(self.path):
            if kind is None or self._pieces:
                last = self._end if kind is None else self._tail
                self._write(last)
                self._stream.truncate(self._offset + len(last))
                if is_shown := self._shown and self._pieces > 0:
                    os.fsync(self._stream.fileno())
                self._stream.close()
                if not is_shown:
                    atomic.commit(self._fresh, self.path)

    def _put(self, piece: bytes) -> None:
        try:
            self._write(piece + self._tail)
        except OSError:
            if self._shown:  # a reader must not find half a piece
                self._stream.truncate(self._offset)
            raise
        self._offset += len(piece)

    def _write(self, content: bytes) -> None:
        self._stream.seek(self._offset)
        done = 0
        while done < len(content):
            done += self._stream.write(content[done:])


class TrackWriter(GrowingFile, ABC):
    """Writes a track frame by frame; the frames before an exception in the block are kept. Raises OSError."""

    @abstractmethod
    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""


class JsonWriter(TrackWriter):
    """Writes a JSON document.

    joints, gestures  as for ``open_writer``
    """

    def __init__(
        self, path: Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._values, self._between = FrameValues(header, joints, gestures), ""
        head = _text(header_values(header, joints))[:-1] + ',"frames":[\n'
        super().__init__(path, head.encode(), b'\n],"complete":false}\n', b'\n],"complete":true}\n')

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        self.append((self._between + _text(self._values.values(frame))).encode())
        self._between = ",\n"


class JsonLinesWriter(TrackWriter):
    """Writes JSON lines, each of which can be read at once.

    joints, gestures  as for ``open_writer``
    """

    def __init__(
        self, path: Path | None, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._values = FrameValues(header, joints, gestures)
        super().__init__(path, f"{_text(header_values(header, joints))}\n".encode(), shown=True)

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        self.append(f"{_text(self._values.values(frame))}\n".encode())


class CsvWriter(TrackWriter):
    """Writes a table frame by frame; rows written before an exception are kept. Raises OSError.

    joints    a joint format, whose columns replace the joints and angles
    gestures  add two columns: the hand's gesture, empty for none, and its confidence
    """

    def __init__(
        self, path: Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._camera, self._columns = header.camera, HandColumns(header.skeleton, joints)
        self._gestures = GestureReader(header.skeleton) if gestures else None
        own = [*self._columns.about, *self._columns.pose, *["gesture", "gesture_confidence"] * gestures]
        self._empty = [""] * len(own)
        super().__init__(path, rows_of([["number", "time_s", "id", "hand", "lost", *own]]))

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        about = [frame.number, f"{frame.time:.6f}"]
        rows = [[*about, hand.id, hand.side_name, "", *self._values(hand, frame.time)] for hand in frame.hands]
        rows += [[*about, lost.id, lost.side_name, lost.reason, *self._empty] for lost in frame.lost]
        rows += [[*about, one.id, one.side_name, one.reason, known("%.3f", one.presence),
                  known("%.4f", one.confidence), *self._empty[2:]] for one in frame.present]
        self.append(rows_of(rows))

    def _values(self, hand: TrackedHand, time: float) -> list[str]:
        values = self._columns.about_values(hand) + self._columns.pose_values(hand, self._camera)
        if self._gestures:
            name, confidence = self._gestures.read(hand.id, hand.hand, hand.xyz, time)
            values += [name, f"{confidence:.3f}"]
        return values


def open_writer(
    path: str | Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
) -> TrackWriter:
    """A writer for a name in .json, .jsonl or .csv, or for "-": JSON lines on standard output. Raises DataError.

    joints    format of additional joints and angles in JSON, and of the joints in CSV
    gestures  add the gesture of each hand to JSON and CSV
    """
    if str(path) == "-":
        return JsonLinesWriter(None, header, joints, gestures)
    path = Path(path)
    writers: dict[str, Callable[..., TrackWriter]] = {".json": JsonWriter, ".jsonl": JsonLinesWriter, ".csv": CsvWriter}
    if (ending := path.suffix.lower()) not in writers:
        raise DataError(f"{path}: cannot write a track of this kind; expected a name in .json, .jsonl or .csv, or - "
                        "for standard output")
    return writers[ending](path, header, joints, gestures)
