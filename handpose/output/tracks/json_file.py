"""A track as JSON: a document with the frames in a list, or JSON lines, a header and then a
line per frame.

docs/hands.schema.json, a JSON Schema, describes every key, its unit and where it is
null or missing:

    header   format, version, source, camera, unit_mm, skeleton ...; in a document with ``frames``
             and ``complete``
    frame    number, time_s, hands, lost
    hands    by id; those whose confidence is below the minimum have a reason and no joints

Lengths are in mm, angles in rad, times in s; the axes are the camera's: x right, y up, z away.
``joint_values`` has the keys of other formats of joints.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from handpose.frames.camera_text import parse_json
from handpose.output.tracks.fields import Fields
from handpose.output.tracks.json_reading import FrameReader, header_of
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib import files
from netlib.errors import DataError


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
    first_line, _, rest = text.partition("\n")
    first = _value_or_none(first_line)
    if isinstance(first, dict) and "frames" not in first:
        return _read_lines(path, Fields(first, f"{path}:1"), rest)
    document = Fields(parse_json(text, str(path)), str(path))
    header = header_of(document)
    reader = FrameReader(header)
    frames = [reader.frame(values) for values in document.parts("frames")]
    return Track(header, frames, "" if document.truth("complete") else "the tracker was stopped")


def _read_lines(path: str | Path, header_fields: Fields, text: str) -> Track:
    """The track of a header and the lines after it, of which the last may be cut."""
    header = header_of(header_fields)
    reader = FrameReader(header)
    lines = text.split("\n")
    cut = ""
    if _value_or_none(lines[-1]) is None:
        last = lines.pop()
        if last:  # otherwise the text ends with a complete line
            cut = f"{path}:{len(lines) + 2}: the line is cut after {len(last)} characters"
    frames = []
    for number, line in enumerate(lines, 2):
        where = f"{path}:{number}"
        frames.append(reader.frame(Fields(parse_json(line, where), where)))
    return Track(header, frames, cut)


def _value_or_none(text: str) -> Any:
    """The value of a JSON text; None if it is cut."""
    try:
        return parse_json(text, "")
    except DataError:
        return None
