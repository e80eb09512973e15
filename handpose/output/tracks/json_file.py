"""A track as JSON: a document with the frames in a list, or JSON lines, a header and then a
line per frame.

docs/hands.schema.json, a JSON Schema, describes every key, its unit and where it is
null or missing:

    header   format, version, source, camera, unit_mm, skeleton ...; in a document with ``frames``
             and ``complete``
    frame    number, time_s, hands, lost
    hands    those that are there, by id; those whose confidence is below the minimum have a
             reason and no joints

Lengths are in mm, angles in rad, times in s; the axes are the camera's: x right, y up, z away.
``joint_values`` has the keys of other formats of joints.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from handpose.frames.camera_text import parse_json
from handpose.output.tracks.fields import Fields
from handpose.output.tracks.json_values import FrameValues, header_of
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
    first, _, rest = text.partition("\n")
    head = _value_or_none(first)
    if isinstance(head, dict) and "frames" not in head:
        return _read_lines(path, Fields(head, f"{path}:1"), rest)
    document = Fields(parse_json(text, str(path)), str(path))
    header = header_of(document)
    values = FrameValues(header)
    frames = [values.frame(frame) for frame in document.parts("frames")]
    return Track(header, frames, "" if document.truth("complete") else "the tracker was stopped")


def _read_lines(path: str | Path, head: Fields, text: str) -> Track:
    header = header_of(head)
    values = FrameValues(header)
    frames = []
    *lines, last = text.split("\n")
    for number, line in enumerate(lines, 2):
        where = f"{path}:{number}"
        frames.append(values.frame(Fields(parse_json(line, where), where)))
    if not last:
        return Track(header, frames)
    where = f"{path}:{len(lines) + 2}"
    whole = _value_or_none(last)
    if whole is None:
        return Track(header, frames, f"{where}: the line is cut after {len(last)} characters")
    return Track(header, [*frames, values.frame(Fields(whole, where))])


def _value_or_none(line: str) -> Any:
    try:
        return parse_json(line, "")
    except DataError:
        return None
