"""The header and the frames of a track as JSON values, and back;
docs/hands.schema.json has the keys.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np

from handpose.body.joint_formats.formats import FormatName
from handpose.body.model import FINGERS
from handpose.body.sides import SIDES, Side
from handpose.fit.pose_confidence import unknown_finger_errors
from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.output.tracks import joint_values
from handpose.output.tracks.fields import Fields
from handpose.output.tracks.plain_numbers import rounded, rounded_if_known
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter, text_of
from netlib.blob import Array
from netlib.errors import DataError
from netlib.proto import prototxt, schema

FORMAT, FORMAT_VERSION = "handpose", 2
READABLE_VERSIONS = (1, 2)  # versions; without presence before 2
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
    camera = {
        name: value if name == "name" else rounded(value, 6)
        for name, value in vars(header.camera).items()
    }
    camera |= {"width": header.camera.width, "height": header.camera.height}
    values = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "source": header.source,
        "smoothed": header.smoothed,
        "units": UNITS,
        "axes": AXES,
        "camera": camera if in_frames else None,
        "unit_mm": float(header.unit_mm),
        "skeleton": _skeleton_values(header.skeleton),
    }
    if joints:
        values["joint_format"] = joint_values.format_values(joints)
    return values


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


def header_of(fields: Fields) -> TrackHeader:
    """The header from its object. Raises DataError, PrototxtError."""
    if "format" not in fields or fields.text("format") != FORMAT:
        raise DataError(
            f"{fields.where}: not a track; expected a file that track --json has written"
        )
    if fields.whole("version") not in READABLE_VERSIONS:
        raise DataError(
            f"{fields.where}: format version {fields.whole('version')}; this program reads {FORMAT_VERSION}"
        )
    if not fields.has("camera"):
        raise DataError(
            f"{fields.where}: predicted from crops without a camera, so positions are relative to crops"
        )
    of = fields.part("camera")
    body = fields.part("skeleton")
    camera = Camera(
        of.text("name"),
        of.positive("fx"),
        of.positive("fy"),
        of.number("u0"),
        of.number("v0"),
        of.whole("width"),
        of.whole("height"),
        of.number("min_range_mm", 0) if "min_range_mm" in of else MIN_RANGE_MM,
    )
    text = prototxt.parse(body.text("prototxt"), f"{body.where} 'prototxt'")
    skeleton = Skeleton(schema.read(text, SkeletonParameter, "a skeleton"))
    return TrackHeader(
        fields.text("source"),
        camera,
        skeleton,
        fields.positive("unit_mm"),
        fields.truth("smoothed"),
    )


# ------------------------------------------------------------------------------------------- frames


class FrameValues:
    """Frames as objects, in order: a hand's bones are in its first one, and where they change.

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
        lost = [
            {"id": int(l.id), "hand": l.hand, "since_s": rounded(l.since, 6), "reason": l.reason}
            for l in frame.lost
        ]
        return {
            "number": int(frame.number),
            "time_s": rounded(frame.time, 6),
            "hands": [self._hand_values(hand) for hand in frame.every if not hand.is_lost],
            "lost": lost,
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
        crop = {
            "center_uvd": rounded_if_known(pose.center_uvd, 3),
            "cube_mm": rounded(pose.cube_mm, 3),
        }
        values["crop"] = crop
        if self._joints is not None:
            values |= joint_values.hand_values(self._joints, pose, self._camera)
        if hand.gesture is not None:
            values["gesture"] = {
                "name": hand.gesture.name or None,
                "number": hand.gesture.number,
                "confidence": rounded(hand.gesture.confidence, 3),
            }
        return values

    def frame(self, fields: Fields) -> TrackedFrame:
        """The next frame from its object. Raises DataError."""
        every = [self._hand(hand) for hand in fields.parts("hands")]
        every += [_lost(of) for of in fields.parts("lost")]
        return TrackedFrame(fields.whole("number"), fields.known("time_s"), tuple(every))

    def _hand(self, of: Fields) -> TrackedHand:
        hand = TrackedHand(
            of.whole("id"),
            _side_of(of),
            of.known("confidence"),
            presence=of.known("presence") if "presence" in of else math.nan,
        )
        if not of.has("positions_mm"):
            return hand.without_pose(hand.hand, of.numbers("palm_mm", 3), of.text("reason"))
        side = hand.hand
        chance = 1.0
        if side is None:
            side = of.one_of("assumed_hand", SIDES)
            chance = of.number("assumed_confidence", 0, 1 - 1e-6)
        return dataclasses.replace(
            hand,
            hand=side,
            side_confidence=chance,
            error_mm=of.known("error_mm"),
            pose=self._pose(of, side),
            finger_error_mm=_finger_errors(of),
        )

    def _pose(self, of: Fields, side: Side) -> HandPose:
        crop = of.part("crop")
        joints = len(self._skeleton.joint_names)
        theta = self._skeleton.initial.copy()
        turning, sliding = [*self._turning.values()], [*self._sliding.values()]
        theta[turning] = _by_name(of, "angles_rad", self._turning)
        theta[sliding] = _by_name(of, "translations_mm", self._sliding) / self._unit_mm
        return HandPose(
            self._skeleton,
            side,
            theta - self._skeleton.initial,
            self._bones_of(of),
            of.numbers("origin_mm", 3),
            of.numbers("positions_mm", joints, 3),
            crop.numbers("center_uvd", 3),
            crop.positive("cube_mm"),
            raw_xyz=of.numbers("raw_positions_mm", joints, 3) if "raw_positions_mm" in of else None,
        )

    def _bones_of(self, of: Fields) -> Array:
        hand = of.whole("id")
        joints = len(self._skeleton.joint_names)
        if "bones_mm" in of:
            known = of.has("bones_mm")
            self._bones[hand] = (
                of.numbers("bones_mm", joints).tolist() if known else [math.nan] * joints
            )
        if hand not in self._bones:
            raise DataError(f"{of.where}: hand {hand} has no 'bones_mm', neither here nor before")
        return np.array(self._bones[hand]) / self._unit_mm


def _named(dofs: dict[str, int], values: Array, decimals: int) -> dict[str, float] | None:
    """The values of DoFs by name; None if they are unknown."""
    numbers = rounded_if_known(values[[*dofs.values()]], decimals)
    return None if numbers is None else dict(zip(dofs, numbers))


def _by_name(of: Fields, key: str, dofs: dict[str, int]) -> Array:
    """The inverse of ``_named``, with NaN for unknown numbers. Raises DataError."""
    if not of.has(key):
        return np.full(len(dofs), np.nan)
    part = of.part(key)
    return np.array([part.number(name) for name in dofs])


def _finger_errors(of: Fields) -> Array:
    """The errors (5,) of the fingers; NaN if they are unknown, and in tracks of
    earlier programs.
    """
    if "finger_error_mm" not in of:
        return unknown_finger_errors()
    part = of.part("finger_error_mm")
    return np.array([part.known(finger) for finger in FINGERS])


def _side_of(of: Fields) -> Side | None:
    return of.one_of("hand", SIDES) if of.has("hand") else None


def _lost(of: Fields) -> TrackedHand:
    return TrackedHand(
        of.whole("id"), _side_of(of), since=of.number("since_s"), reason=of.text("reason")
    )


# ------------------------------------------------------------------------------------------- angles

NO_LIMIT = 9999.0  # rad; the packaged hand stores 10000


def free_dofs(skeleton: Skeleton) -> tuple[dict[str, int], dict[str, int]]:
    """The DoFs that are free and move something, and their indices by name: those that turn a
    joint, in rad; those that translate, in units.
    """
    turning = np.unique(skeleton.driven[skeleton.turns])
    sliding = np.setdiff1d(skeleton.driven, turning)
    names = skeleton.dof_names
    return {names[d]: d for d in turning.tolist()}, {names[d]: d for d in sliding.tolist()}


def _limit(limit: float, initial: float) -> float | None:
    """A limit of an angle in rad, which is its input plus its initial value; None without one."""
    return float(limit) + float(initial) if abs(limit) < NO_LIMIT else None
