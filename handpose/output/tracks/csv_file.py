"""A track as CSV: a row per frame and hand, for tables and plots.

    number, time_s   of the frame in its recording, from 0
    id, hand         the hand's constant number; right or left
    lost             empty, or the reason why the hand or its pose is not found in this frame: then joints are empty
    presence         probability that it is a hand; empty if unknown
    confidence       probability that the joints' mean error is below 30 mm; empty if unknown
    error_mm         expected error; empty likewise
    FINGER_error_mm  of a hand: expected error of each finger, thumb to little; empty likewise
    JOINT_x_mm, JOINT_y_mm, JOINT_z_mm   of each joint, camera axes: x right, y up, z away
    ANGLE_rad        of each angle; for a left hand, of its mirror image

With a joint format (``joint_values``) its columns replace the last two kinds.

A lost hand keeps its rows, so that a plot over time has gaps instead of lines: in pandas, ``read_csv(path)`` reads
empty fields as NaN, and ``table[table.lost.isna()]`` are the rows with a hand. A frame without tracked hands has no
row.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from handpose.body.gestures import GestureReader
from handpose.body.joint_formats.formats import FormatName
from handpose.body.joint_formats.frames import hand_frames
from handpose.body.model import FINGERS, has_fingers
from handpose.output.tracks import joint_values
from handpose.output.tracks.growing import GrowingFile, TrackWriter
from handpose.output.tracks.json_values import free_dofs
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

FIRST = ["number", "time_s", "id", "hand", "lost", "presence", "confidence", "error_mm"]


class CsvWriter(TrackWriter):
    """Writes a table frame by frame; rows written before an exception are kept. Raises OSError.

    joints    a joint format, whose columns replace the joints and angles
    gestures  add two columns: the hand's gesture, empty for none, and its confidence
    """

    def __init__(
        self, path: Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
    ) -> None:
        self._header, self._joints = header, joints
        self._skeleton, self._angles = header.skeleton, free_dofs(header.skeleton).angles
        fingers = finger_columns(header.skeleton)
        columns = joint_values.columns(joints) if joints else model_columns(header.skeleton, self._angles)
        self._gestures = GestureReader(header.skeleton) if gestures else None
        columns += ["gesture", "gesture_confidence"] * gestures
        columns = fingers + columns
        self._empty = [""] * (3 + len(columns))
        super().__init__(path, GrowingFile(path, rows_of([FIRST + columns])))

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        about = [frame.number, f"{frame.time:.6f}"]
        rows = [[*about, hand.id, hand.side_name, "", *self._values(hand, frame.time)] for hand in frame.hands]
        rows += [[*about, lost.id, lost.side_name, lost.reason, *self._empty] for lost in frame.lost]
        rows += [[*about, one.id, one.side_name, one.reason, _known("%.3f", one.presence),
                  _known("%.4f", one.confidence), *self._empty[2:]] for one in frame.present]
        self._pieces.append(rows_of(rows))

    def _values(self, hand: TrackedHand, time: float) -> list[str]:
        values, about = quality(hand.presence, hand.confidence, hand.error_mm), (hand.hand, hand.xyz)
        values += finger_numbers(self._skeleton, hand.finger_error_mm)
        frames = hand_frames(self._skeleton, *about) if self._joints or self._gestures else None
        if self._joints and frames:
            values += joint_values.numbers(self._joints, self._skeleton, *about, self._header.camera, frames)
        else:
            values += model_numbers(hand.xyz, self._skeleton.theta(hand.inputs)[self._angles])
        if self._gestures:
            name, confidence = self._gestures.read(hand.id, *about, time, frames)
            values += [name, f"{confidence:.3f}"]
        return values


def model_columns(skeleton: Skeleton, angles: Sequence[int]) -> list[str]:
    """The columns of the model's joints and of these angles, for ``model_numbers``."""
    joints = [f"{joint}_{axis}_mm" for joint in skeleton.joint_names for axis in "xyz"]
    return joints + [f"{skeleton.dof_names[d]}_rad" for d in angles]


def model_numbers(xyz: Array, angles: Array) -> list[str]:
    """Joints (K, 3) in mm and angles (A,) in rad as fields; empty where they are not finite."""
    return [_known("%.2f", x) for x in xyz.ravel().tolist()] + [_known("%.5f", a) for a in angles.tolist()]


def finger_columns(skeleton: Skeleton) -> list[str]:
    """The columns of the expected errors of a hand's fingers, for ``finger_numbers``; none for other bodies."""
    return [f"{finger}_error_mm" for finger in FINGERS] if has_fingers(skeleton) else []


def finger_numbers(skeleton: Skeleton, errors_mm: Array) -> list[str]:
    """The expected errors (5,) of fingers as fields; empty where they are unknown."""
    return [_known("%.1f", error) for error in errors_mm.tolist()] if has_fingers(skeleton) else []


def quality(presence: float, confidence: float, error_mm: float) -> list[str]:
    """The three as fields; empty if unknown."""
    return [_known("%.3f", presence), _known("%.4f", confidence), _known("%.2f", error_mm)]


def _known(form: str, number: float) -> str:
    return form % number if math.isfinite(number) else ""


def rows_of(rows: Iterable[Sequence[object]]) -> bytes:
    """The lines of rows; characters of file names that are not UTF-8, and carriage returns, are escaped."""
    text = io.StringIO()
    for row in rows:  # not every csv module quotes a carriage return
        cells = [cell.replace("\r", "\\r") if isinstance(cell, str) else cell for cell in row]
        csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode("utf-8", "backslashreplace")
