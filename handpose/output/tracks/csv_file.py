"""A track as CSV: a row per frame and hand, for tables and plots.

    number, time_s   of the frame in its recording, from 0
    id, hand         the hand's constant number; right, left or unknown; empty if no hand has a row
                     in this frame
    lost             empty, or the reason why the hand or its pose is not found in this frame: then
                     joints are empty
    presence         probability that it is a hand; empty if unknown
    confidence       probability that the joints' mean error is below 30 mm; empty if unknown
    error_mm         expected error; empty likewise
    FINGER_error_mm  of a hand: expected error of each finger, thumb to little; empty likewise
    JOINT_x_mm, JOINT_y_mm, JOINT_z_mm   of each joint, camera axes: x right, y up, z away
    ANGLE_rad        of each angle; for a left hand, of its mirror image

With a joint format (``joint_values``) its columns replace the last two kinds.

A lost hand keeps its rows, so that a plot over time has gaps instead of lines: in pandas,
``read_csv(path)`` reads empty fields as NaN, and ``table[table.lost.isna()]`` are the rows with a
hand. A hand has no row before its first joints. A frame in which no hand has a row gets one with
the reason, that of the most present hand if there is one.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Sequence

from handpose.body.joint_formats.formats import FormatName
from handpose.body.model import FINGERS, has_fingers
from handpose.frames.cameras import Camera
from handpose.output.tracks import joint_values
from handpose.output.tracks.json_values import free_dofs
from handpose.output.tracks.plain_numbers import fields_of
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackHeader, side_name
from layers.hand.skeleton import Skeleton

NO_HAND_SEEN = "no hand is seen"
# the columns of what is known of a hand, and the digits of their values
QUALITY = {"presence": 3, "confidence": 4, "error_mm": 2}


class FrameRows:
    """Frames as rows of a table, in the order of time.

    head      the line with the names of the columns
    joints    a joint format, whose columns replace the joints and angles
    gestures  add two columns: the hand's gesture, empty for none, and its confidence
    """

    def __init__(
        self, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._camera = header.camera
        self._columns = columns = HandColumns(header.skeleton, joints)
        self._gestures = gestures
        own = [*columns.about, *columns.pose, *["gesture", "gesture_confidence"] * gestures]
        self._count = len(own)
        self._posed: set[int] = set()  # ids of the hands that had joints
        self.head = rows_of([["number", "time_s", "id", "hand", "lost", *own]])

    def encoded(self, frame: TrackedFrame) -> bytes:
        """The lines of a frame."""
        self._posed.update(hand.id for hand in frame.hands)
        present = [one for one in frame.present if one.id in self._posed]
        rows = [
            [hand.id, side_name(hand.known_side), hand.reason, *self._values(hand)]
            for hand in (*frame.hands, *frame.lost, *present)
        ]
        if not rows:
            most = max(frame.present, key=lambda hand: hand.presence, default=None)
            nothing = [NO_HAND_SEEN, *[""] * self._count]
            rows = [["", "", *([most.reason, *self._values(most)] if most else nothing)]]
        return rows_of([frame.number, f"{frame.time:.6f}", *row] for row in rows)

    def _values(self, hand: TrackedHand) -> list[str]:
        values = self._columns.about_values(hand)
        if hand.pose is None:
            return values[:2] + [""] * (self._count - 2)
        values += self._columns.pose_values(hand.pose, self._camera)
        if self._gestures:
            name, confidence = hand.gesture or ("", math.nan)
            values += [name, *fields_of(confidence, 3)]
        return values


class HandColumns:
    """The columns of a hand in tables of tracks and of predictions.

    about  names of those of its quality
    pose   names of those of its joints, and of its angles unless ``angles`` is False
    """

    def __init__(self, skeleton: Skeleton, joints: FormatName | None, angles: bool = True) -> None:
        self._skeleton = skeleton
        self._joints = joints
        self._angles = free_dofs(skeleton)[0] if angles else {}
        self._fingers = len(FINGERS) if has_fingers(skeleton) else 0
        self.about = [*QUALITY, *(f"{finger}_error_mm" for finger in FINGERS[: self._fingers])]
        self.pose = [f"{joint}_{axis}_mm" for joint in skeleton.joint_names for axis in "xyz"]
        self.pose += [f"{name}_rad" for name in self._angles]
        if joints:
            self.pose = joint_values.columns(joints)

    def about_values(self, hand: TrackedHand) -> list[str]:
        """The fields of ``about``; empty if unknown."""
        values = [fields_of(getattr(hand, name), digits) for name, digits in QUALITY.items()]
        return [*itertools.chain(*values), *fields_of(hand.finger_error_mm[: self._fingers], 1)]

    def pose_values(self, pose: HandPose, camera: Camera | None) -> list[str]:
        """The fields of ``pose``; empty if unknown.

        Without a camera, positions are from the middle of the crop.
        """
        if self._joints:
            return joint_values.numbers(self._joints, pose, camera)
        angles = self._skeleton.theta(pose.inputs)[[*self._angles.values()]]
        return fields_of(pose.xyz, 2) + fields_of(angles, 5)


def rows_of(rows: Iterable[Sequence[object]]) -> bytes:
    """The lines of rows; characters of file names that are not UTF-8, and carriage
    returns, are escaped.
    """
    text = io.StringIO()
    for row in rows:  # not every csv module quotes a carriage return
        cells = [cell.replace("\r", "\\r") if isinstance(cell, str) else cell for cell in row]
        csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode("utf-8", "backslashreplace")
