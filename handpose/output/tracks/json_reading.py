"""The header and the frames of a track from the JSON values that ``json_values`` makes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from handpose.body.model import FINGERS
from handpose.body.sides import SIDES, Side
from handpose.estimate.nets import is_hand
from handpose.fit.pose_confidence import unknown_finger_errors
from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.output.tracks.fields import Fields
from handpose.output.tracks.json_values import FORMAT, free_dofs
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.blob import Array
from netlib.errors import DataError
from netlib.proto import prototxt, schema

READABLE_VERSIONS = (1, 2)  # before 2, hands have no presence


# --------------------------------------------------------------------------------------- the header


def header_of(fields: Fields) -> TrackHeader:
    """The header from its object. Raises DataError, PrototxtError."""
    _check_format(fields)
    if not fields.has("camera"):
        raise DataError(
            f"{fields.where}: predicted from crops without a camera, so positions are relative to crops"
        )
    camera = _camera_of(fields.part("camera"))
    skeleton = _skeleton_of(fields.part("skeleton"))
    unit_mm = fields.positive("unit_mm")
    return TrackHeader(fields.text("source"), camera, skeleton, unit_mm, fields.truth("smoothed"))


def _check_format(fields: Fields) -> None:
    """Raise DataError unless this is a track, and of a readable version."""
    if "format" not in fields or fields.text("format") != FORMAT:
        raise DataError(
            f"{fields.where}: not a track; expected a file that track --json has written"
        )
    version = fields.whole("version")
    if version not in READABLE_VERSIONS:
        readable = " and ".join(map(str, READABLE_VERSIONS))
        raise DataError(f"{fields.where}: format version {version}; this program reads {readable}")


def _camera_of(of: Fields) -> Camera:
    return Camera(
        of.text("name"),
        of.positive("fx"),
        of.positive("fy"),
        of.number("u0"),
        of.number("v0"),
        of.whole("width"),
        of.whole("height"),
        of.number("min_range_mm", 0) if "min_range_mm" in of else MIN_RANGE_MM,
    )


def _skeleton_of(of: Fields) -> Skeleton:
    """The body of the prototxt in an object. Raises DataError, PrototxtError."""
    text = prototxt.parse(of.text("prototxt"), f"{of.where} 'prototxt'")
    return Skeleton(schema.read(text, SkeletonParameter, "a skeleton"))


# ------------------------------------------------------------------------------------------- frames


class FrameReader:
    """The frames of a track from their objects, in order: a hand without bones has those of the
    frame before.
    """

    def __init__(self, header: TrackHeader) -> None:
        self._skeleton = header.skeleton
        self._unit_mm = header.unit_mm
        self._turning, self._sliding = free_dofs(header.skeleton)
        self._bones_mm: dict[int, Array] = {}  # (K,) of each hand, by its id

    def frame(self, fields: Fields) -> TrackedFrame:
        """The next frame from its object. Raises DataError."""
        every = [self._hand(hand) for hand in fields.parts("hands")]
        every += [_lost(hand) for hand in fields.parts("lost")]
        return TrackedFrame(fields.whole("number"), fields.known("time_s"), tuple(every))

    def _hand(self, of: Fields) -> TrackedHand:
        """A hand with its pose, or with its place and the reason. Raises DataError."""
        presence = of.known("presence") if "presence" in of else math.nan
        hand = TrackedHand(of.whole("id"), _side_of(of), of.known("confidence"), presence=presence)
        if not of.has("positions_mm"):
            return hand.without_pose(hand.hand, of.numbers("palm_mm", 3), of.text("reason"))
        side, chance = hand.hand, 1.0
        if side is None:
            side, chance = self._assumed_side(of)
        pose = self._pose(of, side or "right")
        hand = dataclasses.replace(hand, hand=side, side_confidence=chance, pose=pose)
        return dataclasses.replace(
            hand, error_mm=of.known("error_mm"), finger_error_mm=_finger_errors(of)
        )

    def _assumed_side(self, of: Fields) -> tuple[Side | None, float]:
        """The side that is assumed of an undecided hand, and its probability; None and 1 for
        another body, which has no side. Raises DataError.
        """
        if "assumed_hand" not in of and not is_hand(self._skeleton):
            return None, 1.0
        return of.one_of("assumed_hand", SIDES), of.number("assumed_confidence", 0, 1 - 1e-6)

    def _pose(self, of: Fields, side: Side) -> HandPose:
        """The pose of a hand of this side. Raises DataError."""
        crop = of.part("crop")
        joints = len(self._skeleton.joint_names)
        raw = None
        if "raw_positions_mm" in of:
            raw = of.numbers("raw_positions_mm", joints, 3)
        return HandPose(
            self._skeleton,
            side,
            self._inputs(of),
            self._bones(of),
            of.numbers("origin_mm", 3),
            of.numbers("positions_mm", joints, 3),
            crop.numbers("center_uvd", 3),
            crop.positive("cube_mm"),
            raw_xyz=raw,
        )

    def _inputs(self, of: Fields) -> Array:
        """The inputs (D,) of the skeleton; those that move nothing are 0. Raises DataError."""
        initial = self._skeleton.initial
        theta = initial.copy()
        theta[[*self._turning.values()]] = _by_name(of, "angles_rad", self._turning)
        slides_mm = _by_name(of, "translations_mm", self._sliding)
        theta[[*self._sliding.values()]] = slides_mm / self._unit_mm
        return theta - initial

    def _bones(self, of: Fields) -> Array:
        """The bones (K,) in units: of this frame, or of the last one that has them. Raises
        DataError if none has.
        """
        hand = of.whole("id")
        joints = len(self._skeleton.joint_names)
        if "bones_mm" in of:
            unknown = np.full(joints, np.nan)
            self._bones_mm[hand] = of.numbers("bones_mm", joints) if of.has("bones_mm") else unknown
        if hand not in self._bones_mm:
            raise DataError(f"{of.where}: hand {hand} has no 'bones_mm', neither here nor before")
        return self._bones_mm[hand] / self._unit_mm


def _by_name(of: Fields, key: str, dofs: dict[str, int]) -> Array:
    """The values of DoFs in an object, in their order; NaN if it is null. Raises DataError."""
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
