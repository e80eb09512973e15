"""Writers of tracks, by the ending of a name; their files are complete however the program ends.

with open_writer("wave.json", header) as writer:
    for frame in frames:
        writer.write(frame)
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path

from handpose.body.joint_formats.formats import FormatName
from handpose.output.tracks.csv_file import FrameRows
from handpose.output.tracks.json_values import FrameValues, header_values, to_text
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.errors import DataError
from netlib.files import atomic


class TrackWriter:
    """Writes a track frame by frame, next to ``path``, and renames the file at the end of the
    block; raises OSError.

    After an exception in the block, such as Ctrl-C or a full disk, the complete frames are kept;
    without any, the old file.

    path     None: standard output, to which each frame is written at once
    encode   the bytes of a frame
    head     first bytes
    between  bytes before each frame but the first
    tail     last bytes: they are written after every frame, and overwritten by the next, so that no
             failure truncates them
    end      replaces ``tail`` at the end of a block without an exception; not longer
    shown    rename it after the first frame instead, so that the others can be read as
             they are written
    """

    def __init__(
        self,
        path: Path | None,
        encode: Callable[[TrackedFrame], bytes],
        head: bytes = b"",
        between: bytes = b"",
        tail: bytes = b"",
        end: bytes | None = None,
        shown: bool = False,
    ) -> None:
        self.path, self._encode, self._head, self._between = path, encode, head, between
        self._tail, self._end, self._shown = tail, tail if end is None else end, shown
        self._offset = 0  # of the next frame
        self._frames = 0

    def __enter__(self) -> TrackWriter:
        if self.path is None:
            self._print(self._head)
            return self
        with contextlib.ExitStack() as stack:
            stack.enter_context(atomic.error_names(self.path))
            atomic.require_regular_file(self.path)
            self._fresh = stack.enter_context(atomic.temporary(self.path))
            self._stream = stack.enter_context(self._fresh.open("wb", buffering=0))
            self._put(self._head)
            self._stack = stack.pop_all()
        return self

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        piece = self._between * (self._frames > 0) + self._encode(frame)
        if self.path is None:
            self._print(piece)
        else:
            with atomic.error_names(self.path):
                self._put(piece)
                if self._shown and not self._frames:
                    atomic.commit(self._fresh, self.path, sync=False)
        self._frames += 1

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self.path is None:
            return
        with self._stack, atomic.error_names(self.path):
            if kind is None or self._frames:
                last = self._end if kind is None else self._tail
                self._write(last)
                self._stream.truncate(self._offset + len(last))
                if is_shown := self._shown and self._frames > 0:
                    os.fsync(self._stream.fileno())
                self._stream.close()
                if not is_shown:
                    atomic.commit(self._fresh, self.path)

    def _put(self, piece: bytes) -> None:
        try:
            self._write(piece + self._tail)
        except OSError:
            if self._shown:  # a reader must not find half a frame
                self._stream.truncate(self._offset)
            raise
        self._offset += len(piece)

    def _write(self, content: bytes) -> None:
        self._stream.seek(self._offset)
        done = 0
        while done < len(content):
            done += self._stream.write(content[done:])

    def _print(self, piece: bytes) -> None:
        if sys.stdout is None:  # a shell closed it
            raise OSError(errno.EBADF, "is closed", "standard output")
        sys.stdout.write(piece.decode("ascii"))
        sys.stdout.flush()


def open_writer(
    path: str | Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
) -> TrackWriter:
    """A writer for a name in .json, .jsonl or .csv, or for "-": JSON lines on standard output.

    Raises DataError.

    joints    format of additional joints and angles in JSON, and of the joints in CSV
    gestures  with the gestures of hands as columns of CSV; JSON has those that were read
    """
    place = None if str(path) == "-" else Path(path)
    ending = place.suffix.lower() if place else ".jsonl"
    if ending not in (".json", ".jsonl", ".csv"):
        raise DataError(
            f"{path}: cannot write a track of this kind; expected a name in .json, .jsonl or .csv, or - "
            "for standard output"
        )
    if ending == ".csv":
        rows = FrameRows(header, joints, gestures)
        return TrackWriter(place, rows.encoded, rows.head)
    frames = FrameValues(header, joints)
    head = to_text(header_values(header, joints))

    def encode(frame: TrackedFrame) -> bytes:
        return to_text(frames.values(frame)).encode()

    if ending == ".jsonl":
        return TrackWriter(
            place, lambda frame: encode(frame) + b"\n", f"{head}\n".encode(), shown=True
        )
    return TrackWriter(
        place,
        encode,
        f'{head[:-1]},"frames":[\n'.encode(),
        between=b",\n",
        tail=b'\n],"complete":false}\n',
        end=b'\n],"complete":true}\n',
    )
