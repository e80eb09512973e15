"""Tracks as BVH, which Blender and other animation programs import: one file for each hand.

Angles and bones are those of the track: a joint rotates by its angles, in the skeleton's order. The bones are those of
the hand's last frame, when its size is known best. Fixed angles, such as those of the metacarpals, are constant
channels. A bone has the name of the joint at its end.

    axes    right-handed: x right, y up, z TOWARDS the camera; the camera is at the origin. Left hands stay left hands
    length  1 is a metre, as in Blender's default import settings. For programs that use centimetres: scale 100
    time    BVH has a rate only. It is that of the recording, or the most frequent one; if frames come in bursts, the
            rate over these. Every BVH frame shows the recording's frame closest in time. A lost hand keeps its last
            pose, and has its first pose before it is found: all files of a recording begin and end together

Poses of the wrong side, before the side was decided, are left out.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np

from handpose.body.sides import Side, mirror_of
from handpose.output.tracks.bvh_joints import AXES, BvhJoint, bone_of, bvh_joints, channels_of, offset_of
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic

TOWARDS = np.array([1.0, 1.0, -1.0])  # from camera axes, whose z is away
METRE = 1000.0
MAX_FRAMES = 10_000  # without another word, and more of those that ...
MAX_VALUES = 10  # BVH frames per frame of the recording; gaps of hours would become millions
BURST = 24  # maximum number of steps in a window
SHARE = 8  # a window has at most 1 / SHARE of all steps, so few windows contain a pause
MAX_SPREAD = 1.5  # maximum ratio of a step to the usual one, because of lost frames and coarse clocks
RATE = 30.0  # rate of a track of one frame


class BvhWriter:
    """Collects the poses of each hand; the end of the block writes NAME_right_0.bvh ... by side and id.

    The files are also written after an exception. Raises OSError, DataError.

    path     NAME.bvh, next to which the files are written
    files    the files written
    rate     frames per second; None: estimated from the times
    unit_mm  of lengths in the file
    """

    def __init__(self, path: Path, header: TrackHeader, rate: float | None = None, unit_mm: float = METRE) -> None:
        self.files: list[Path] = []
        self._path, self._header, self._rate, self._unit_mm = path, header, rate, unit_mm
        self._times: list[float] = []
        self._hands: dict[int, TrackedHand] = {}  # the last one by id
        self._poses: dict[tuple[int, str], list[_Pose]] = {}  # by id and hand

    def __enter__(self) -> BvhWriter:
        with atomic.error_names(self._path), atomic.temporary(self._path):  # fail early if the folder is missing
            return self

    def write(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        for hand in frame.hands:
            self._hands[hand.id] = hand
            pose = _Pose(len(self._times), hand.inputs, hand.origin_mm)
            self._poses.setdefault((hand.id, hand.hand), []).append(pose)
        self._times.append(frame.time)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        for id, hand in sorted(self._hands.items()):
            path = self._path.with_name(f"{self._path.stem}_{hand.hand}_{id}{self._path.suffix}")
            atomic.replace_text(path, self._text(hand))
            self.files.append(path)

    def _text(self, hand: TrackedHand) -> str:
        frames, inputs, origins = map(np.array, zip(*self._poses[hand.id, hand.hand]))
        nearest, rate = nearest_frames(np.array(self._times), self._rate)
        shown = np.maximum(np.searchsorted(frames, nearest, "right") - 1, 0)
        return bvh_text(self._header, hand.hand, inputs[shown], origins[shown], hand.bones, rate, self._unit_mm)


class _Pose(NamedTuple):
    frame: int  # number of files written before
    inputs: Array
    origin_mm: Array


def nearest_frames(times: Array, rate: float | None = None) -> tuple[Array, float]:
    """For equally spaced moments from the first to the last, the numbers of the frames nearest to them; and the rate.

    times  (N,) s, ascending
    rate   of the moments; None: as between most frames, or if they come in bursts, as over most bursts
    """
    if rate is None:
        step = _usual_step(times, 1)
        over_bursts = _usual_step(times, min(BURST, max(1, (len(times) - 1) // SHARE)))
        if max(step, over_bursts) > MAX_SPREAD * min(step, over_bursts):
            step = over_bursts
        rate = 1 / step if step > 0 else RATE
    length = (times[-1] - times[0]) * rate
    most = max(MAX_FRAMES, MAX_VALUES * len(times))
    if not length < most:
        raise DataError(f"{len(times)} frames from {times[0]:g} s to {times[-1]:g} s, {rate:g} a second, would be "
                        f"{length:.3g} frames of BVH; at most {most} are written")
    moments = times[0] + np.arange(round(length) + 1) / rate
    return np.searchsorted((times[1:] + times[:-1]) / 2, moments), rate


def _usual_step(times: Array, count: int) -> float:
    """The median duration in s of windows of steps, by the number of steps."""
    return float(np.median(times[count:] - times[:-count])) / count if len(times) > count else 0.0


def bvh_text(
    header: TrackHeader, hand: Side, inputs: Array, origins_mm: Array, bones: Array, rate: float, unit_mm: float = METRE
) -> str:
    """The BVH file of one hand.

    hand        "right" or "left"
    inputs      (N, D) in N frames, as in ``TrackedHand``
    origins_mm  (N, 3) likewise
    bones       (K,) in all of them, in the header's units
    rate        frames per second
    unit_mm     of lengths in the file
    """
    joints, sk, scale = bvh_joints(header.skeleton), header.skeleton, header.unit_mm / unit_mm
    signs = TOWARDS * mirror_of(hand)
    theta, columns = sk.theta(inputs), []
    for joint in joints:
        position, angles = channels_of(sk, joint, theta, bones, signs)
        if position is not None:
            origin = origins_mm / unit_mm * TOWARDS if joint is joints[0] else 0.0
            columns.append(position * scale + origin)
        columns.append(np.unwrap(np.degrees(angles), axis=0, period=360))  # programs draw curves through the frames
    rows = np.concatenate(columns, axis=1).round(7) + 0.0
    form = " ".join(["%.7f"] * rows.shape[1])
    lines = _hierarchy(sk, joints, bones, scale, signs)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / rate:.9f}", *(form % tuple(row) for row in rows)]
    return "\n".join(lines) + "\n"


def _hierarchy(sk: Skeleton, joints: list[BvhJoint], bones: Array, scale: float, signs: Array) -> list[str]:
    lines = ["HIERARCHY"]

    def add(depth: int, *words: object) -> None:
        lines.append("\t" * depth + " ".join(map(str, words)))

    def add_offset(depth: int, offset: Array) -> None:
        add(depth, "OFFSET", *(f"{number:.7f}" for number in (offset * scale * signs).round(7) + 0.0))

    for i, joint in enumerate(joints):
        add(joint.depth, "JOINT" if i else "ROOT", joint.name)
        add(joint.depth, "{")
        add_offset(joint.depth + 1, offset_of(sk, joint, bones))
        names = [f"{axis}position" for axis in AXES] * joint.moves + [f"{AXES[a]}rotation" for a in joint.order]
        add(joint.depth + 1, "CHANNELS", len(names), *names)
        if joint.ends:
            add(joint.depth + 1, "End Site")
            add(joint.depth + 1, "{")
            add_offset(joint.depth + 2, bone_of(sk, joint.joint, bones))
            add(joint.depth + 1, "}")
        following = joints[i + 1].depth if i + 1 < len(joints) else 0
        for depth in range(joint.depth, following - 1, -1):
            add(depth, "}")
    return lines
