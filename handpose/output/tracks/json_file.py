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

from pathlib import Path
from typing import Any, NamedTuple

from handpose.frames.camera_file import parsed
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
