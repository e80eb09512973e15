"""A track as JSON: a document with the frames in a list, or JSON lines, a header and then a line per frame.

docs/hands.schema.json describes the same keys as a JSON Schema.

The header, once:

    format, version  "handpose", 2; a change that old readers misread changes the version
    source           the recording's name
    smoothed         true if poses were smoothed over time
    units, axes      in words: lengths in mm, angles in rad, time in s; x right, y up, z away from the camera
    camera           name, fx, fy, u0, v0 in px, width and height of the frames in px (0 for images of several sizes);
                     without distortion; null for hands in crops without frames: then positions are from the crop's
                     centre
    unit_mm          the unit of lengths in ``prototxt``
    skeleton         name of the body, and
        joints         names; arrays of joints are in this order
        parents        name of each joint's parent; null for a root
        bones          pairs of names, parent and joint, for drawing
        angles         name, lower and upper limit in rad of each angle; null without a limit
        translations   names of the body's translations
        prototxt       the skeleton file, which maps angles, translations and bones to positions
    joint_format     with a format of joints: its name, joints, bones, length, axes, and the angles
    frames           in a document only: the list
    complete         in a document only, the last key: true if the recording was finished, false if it was stopped

A frame:

    number, time_s   in the recording, from 0; time_s is null for single images
    image, picture   for single images only: the file, and the file of its picture
    hands            the hands that are there, by id
        id, hand         the hand's constant number; "right" or "left", or null while its side is undecided: then also
                         assumed_hand, which angles and positions are of, and its probability assumed_confidence
        presence         probability that it is a hand; null if unknown, as where its place was given
        confidence       probability that the joints' mean error is below 30 mm; null if unknown
        palm_mm          the middle of the hand, camera axes
        reason           only of a hand whose confidence is below the minimum: why it has no joints, a line; then
                         positions_mm is null, and the further keys are missing
        error_mm         expected error; null likewise
        finger_error_mm  expected error of each finger, by name: mean over PIP joint, DIP joint and tip; null likewise
        positions_mm     (x, y, z) of each joint, camera axes, to 0.01 mm
        raw_positions_mm likewise, before smoothing; only of smoothed tracks in files
        angles_rad       by name; of a left hand, those of its mirror image; null without a fit
        origin_mm        the origin of the translations, camera axes
        translations_mm  by name; of a left hand, those of its mirror image; null without a fit
        bones_mm         signed length of each joint's bone, 0 without one: in the first frame of this id, and wherever
                         they have changed since; null without a fit
        crop             center_uvd (px, px, mm; null without a camera) and cube_mm of the hand's crop
        gesture          with gestures only: its name, null for none; number of straight fingers, null of pinch and
                         thumb_up; confidence, 0 to 1 (``handpose.body.gestures``)
        mediapipe, mano, nyu, anatomical_deg   with a format of joints (``joint_values``)
    lost             hands tracked before: id, hand (or null), since_s (reported last), reason (a line)
"""

from __future__ import annotations

import errno
import json
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from handpose.body.joint_formats.formats import FormatName
from handpose.frames.json_fields import Fields, parsed
from handpose.output.tracks.growing import GrowingFile, TrackWriter
from handpose.output.tracks.json_values import FrameValues, header_of, header_values
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib import files
from netlib.errors import DataError

_text = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode  # ASCII only


class JsonWriter(TrackWriter):
    """Writes a JSON document frame by frame; it is also complete after an exception in the block. Raises OSError."""

    def __init__(
        self, path: Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._values, self._between = FrameValues(header, joints, gestures), ""
        head = _text(header_values(header, joints))[:-1] + ',"frames":[\n'
        self._file = GrowingFile(path, head.encode(), b'\n],"complete":false}\n')
        super().__init__(path, self._file)

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        self._file.append((self._between + _text(self._values.values(frame))).encode())
        self._between = ",\n"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if kind is None:
            self._file.finish(b'\n],"complete":true}\n')
        super().__exit__(kind, error, where)


class JsonLinesWriter(TrackWriter):
    """Writes JSON lines, each of which can be read at once. Raises OSError.

    path    of the file, which appears, or replaces an old one, with the first frame; None: standard output
    joints, gestures  as for ``open_writer``
    """

    def __init__(
        self, path: Path | None, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._values = FrameValues(header, joints, gestures)
        head = f"{_text(header_values(header, joints))}\n".encode()
        super().__init__(path, GrowingFile(path, head, shown=True) if path else _StandardOutput(head))

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        self._pieces.append(f"{_text(self._values.values(frame))}\n".encode())


class _StandardOutput:
    """Writes pieces to standard output, each at once."""

    def __init__(self, head: bytes) -> None:
        self._head = head

    def __enter__(self) -> _StandardOutput:
        self.append(self._head)
        return self

    def append(self, piece: bytes) -> None:
        """Write a piece. Raises OSError."""
        if sys.stdout is None:  # a shell closed it
            raise OSError(errno.EBADF, "is closed", "standard output")
        sys.stdout.write(piece.decode("ascii"))
        sys.stdout.flush()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        """Do nothing."""


class Track(NamedTuple):
    """A complete track.

    cut  the reason why there are fewer frames than in the recording, else empty
    """

    header: TrackHeader
    frames: list[TrackedFrame]
    cut: str = ""


def read_track(path: str | Path) -> Track:
    """The track of a JSON document, or of the complete JSON lines. Raises DataError, PrototxtError.

    Capsules are not in a track, and inputs that move nothing are 0.
    """
    text = files.read_text(path, "a track")
    first, _, rest = text.partition("\n")
    head = _value_or_none(first)
    if isinstance(head, dict) and "frames" not in head:
        return _read_lines(path, Fields(head, f"{path}:1"), rest)
    return _read_document(Fields(parsed(text, str(path)), str(path)))


def _read_document(fields: Fields) -> Track:
    header = header_of(fields)
    values = FrameValues(header)
    frames = [values.frame(frame) for frame in fields.parts("frames")]
    return Track(header, frames, "" if fields.truth("complete") else "the tracker was stopped")


def _read_lines(path: str | Path, head: Fields, text: str) -> Track:
    header = header_of(head)
    values, frames = FrameValues(header), []
    *lines, last = text.split("\n")
    for number, line in enumerate(lines, 2):
        where = f"{path}:{number}"
        frames.append(values.frame(Fields(parsed(line, where), where)))
    if not last:
        return Track(header, frames)
    where = f"{path}:{len(lines) + 2}"
    whole = _value_or_none(last)
    if whole is None:
        return Track(header, frames, f"{where}: the line is cut after {len(last)} characters")
    return Track(header, [*frames, values.frame(Fields(whole, where))])


def _value_or_none(line: str) -> Any:
    try:
        return parsed(line, "")
    except DataError:
        return None
