"""The header and the frames of a track as JSON values, which ``json_reading`` reads;
docs/hands.schema.json has the keys.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from handpose.body.joint_formats.formats import FormatName
from handpose.body.model import FINGERS
from handpose.fit.joints.angles import rotations
from handpose.frames.cameras import Camera
from handpose.output.tracks import joint_values
from handpose.output.tracks.plain_numbers import rounded, rounded_if_known
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from netlib.blob import Array

FORMAT, FORMAT_VERSION = "handpose", 2
UNITS = {"length": "mm", "angle": "rad", "time": "s", "pixel": "px"}
AXES = {"x": "right", "y": "up", "z": "away from the camera"}


to_text = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode  # ASCII only


# --------------------------------------------------------------------------------------- the header


def header_values(
    header: TrackHeader, joints: FormatName | None = None, *, in_frames: bool = True
) -> dict[str, Any]:
    """The header as an object; ``joints`` is an additional format of hands.

    ``in_frames`` as for ``FrameValues``.
    """
    values = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "source": header.source,
        "smoothed": header.smoothed,
        "units": UNITS,
        "axes": AXES,
        "camera": _camera_values(header.camera) if in_frames else None,
        "unit_mm": float(header.unit_mm),
        "skeleton": _skeleton_values(header.skeleton),
    }
    if joints:
        values["joint_format"] = joint_values.format_values(joints)
    return values


def _camera_values(camera: Camera) -> dict[str, Any]:
    numbers = {name: rounded(value, 6) for name, value in vars(camera).items() if name != "name"}
    return {"name": camera.name, **numbers, "width": camera.width, "height": camera.height}


def _skeleton_values(skeleton: Skeleton) -> dict[str, Any]:
    joints = skeleton.joint_names
    turning, sliding = free_dofs(skeleton)
    parents = [joints[parent] if parent >= 0 else None for parent in skeleton.parents]
    angles = [
        {
            "name": name,
            "lower": _limit(skeleton.lower[d], skeleton.initial[d]),
            "upper": _limit(skeleton.upper[d], skeleton.initial[d]),
        }
        for name, d in turning.items()
    ]
    return {
        "name": skeleton.name,
        "joints": joints,
        "parents": parents,
        "bones": [[parent, joint] for parent, joint in zip(parents, joints) if parent is not None],
        "angles": angles,
        "translations": list(sliding),
        "prototxt": text_of(skeleton.param, skeleton.name, ""),
    }


# ------------------------------------------------------------------------------------------- frames


class FrameValues:
    """The objects of frames, in order: a hand's bones are in its first one, and where they change.

    joints      an additional format of hands
    live        write the bones in every frame, for receivers that miss some, and no raw positions:
                messages are short
    in_frames   False for hands in crops without their frames: positions are from the crop's centre,
                without a camera
    """

    def __init__(
        self,
        header: TrackHeader,
        joints: FormatName | None = None,
        live: bool = False,
        in_frames: bool = True,
    ) -> None:
        self._skeleton = header.skeleton
        self._unit_mm = header.unit_mm
        self._camera = header.camera if in_frames else None
        self._joints = joints
        self._has_raw = header.smoothed and not live
        self._live = live
        self._turning, self._sliding = free_dofs(header.skeleton)
        self._bones: dict[int, list[float] | None] = {}

    def values(self, frame: TrackedFrame) -> dict[str, Any]:
        """One frame as an object."""
        return {
            "number": int(frame.number),
            "time_s": rounded(frame.time, 6),
            "hands": [self._hand_values(hand) for hand in frame.every if not hand.is_lost],
            "lost": [_lost_values(hand) for hand in frame.lost],
        }

    def _hand_values(self, hand: TrackedHand) -> dict[str, Any]:
        values = {"id": int(hand.id), "hand": hand.known_side}
        if hand.side_confidence < 1:
            values["assumed_hand"] = hand.hand
            values["assumed_confidence"] = rounded(hand.side_confidence, 3)
        values["presence"] = rounded(hand.presence, 3)
        values["confidence"] = rounded(hand.confidence, 4)
        if hand.pose is not None:
            return values | self._pose_values(hand, hand.pose)
        values |= {"palm_mm": rounded(hand.place, 1), "positions_mm": None}
        if self._has_raw:
            values["raw_positions_mm"] = None
        return values | {"reason": hand.reason}

    def _pose_values(self, hand: TrackedHand, pose: HandPose) -> dict[str, Any]:
        """The errors and the pose of a hand, the joint format if requested, and the gesture."""
        theta = self._skeleton.theta(pose.inputs)
        positions = pose.xyz.round(2)  # so that the palm is that of the positions in the file
        fingers = rounded(hand.finger_error_mm, 1)
        values = {
            "error_mm": rounded(hand.error_mm, 2),
            "palm_mm": rounded(positions.mean(axis=0), 1),
            "finger_error_mm": dict(zip(FINGERS, fingers)),
            "positions_mm": rounded(positions, 2),
        }
        if pose.raw_xyz is not None and not self._live:
            values["raw_positions_mm"] = rounded(pose.raw_xyz, 2)
        values |= {
            "angles_rad": _named(self._turning, theta, 5),
            "origin_mm": rounded(pose.origin_mm, 3),
            "translations_mm": _named(self._sliding, theta * self._unit_mm, 3),
        }
        bones = rounded_if_known(pose.bones * self._unit_mm, 3)
        if self._live or hand.id not in self._bones or self._bones[hand.id] != bones:
            values["bones_mm"] = self._bones[hand.id] = bones
        values["crop"] = {
            "center_uvd": rounded_if_known(pose.center_uvd, 3),
            "cube_mm": rounded(pose.cube_mm, 3),
        }
        if self._joints is not None:
            values |= joint_values.hand_values(self._joints, pose, self._camera)
        if hand.gesture is not None:
            values["gesture"] = {
                "name": hand.gesture.name or None,
                "number": hand.gesture.number,
                "confidence": rounded(hand.gesture.confidence, 3),
            }
        return values


def _lost_values(hand: TrackedHand) -> dict[str, Any]:
    return {
        "id": int(hand.id),
        "hand": hand.hand,
        "since_s": rounded(hand.since, 6),
        "reason": hand.reason,
    }


def _named(dofs: dict[str, int], values: Array, decimals: int) -> dict[str, float] | None:
    """The values of DoFs by name; None if they are unknown."""
    numbers = rounded_if_known(values[[*dofs.values()]], decimals)
    return None if numbers is None else dict(zip(dofs, numbers))


# ------------------------------------------------------------------------------------------- angles

NO_LIMIT = 9999.0  # rad; the packaged hand stores 10000


def free_dofs(skeleton: Skeleton) -> tuple[dict[str, int], dict[str, int]]:
    """The DoFs that are free and move something, and their indices by name: those that turn a
    joint, in rad; those that translate, in units.
    """
    turning = rotations(skeleton)
    sliding = np.setdiff1d(skeleton.driven, turning)
    names = skeleton.dof_names
    return {names[d]: d for d in turning.tolist()}, {names[d]: d for d in sliding.tolist()}


def _limit(limit: float, initial: float) -> float | None:
    """A limit of an angle in rad, which is its input plus its initial value; None without one."""
    return float(limit) + float(initial) if abs(limit) < NO_LIMIT else None
