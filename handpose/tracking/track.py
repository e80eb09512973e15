"""Tracks of hands: what a tracker outputs for every frame, and the truth of a synthetic recording.

A pose has inputs of the skeleton, bones, and an origin. The inputs of a left hand are those of its
mirror image, a right hand; ``joints_of`` computes its joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.capsules import Capsules
from handpose.body.gestures import Gesture, GestureReader
from handpose.body.joint_formats.angles import anatomical_angles
from handpose.body.nyu import CUBE_MM
from handpose.body.sides import Side, mirror_of
from handpose.fit.body import WorldPose
from handpose.fit.pose_confidence import unknown_finger_errors
from handpose.frames.cameras import Camera
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

# Beginnings of the reasons why a hand is missing from a frame, for trackers and for
# synthetic truth.
LEFT = "left the image"
HIDDEN = "hidden"
PARTLY = "partly in sight"  # in synthetic recordings: such frames are not scored


@dataclass(frozen=True)
class TrackHeader:
    """The properties of all frames of a track.

    source    name of the recording
    camera    of the frames, without distortion
    skeleton  of a right hand; D DoFs, K joints
    unit_mm   length unit of inputs and skeleton
    smoothed  True if poses were smoothed over time
    """

    source: str
    camera: Camera
    skeleton: Skeleton
    unit_mm: float = CUBE_MM / 2
    smoothed: bool = True


class TrackedPoses(NamedTuple):
    """The poses of a tracked hand, in the axes of the fit, which are mirrored for a left hand.

    fitted    of the fit
    smoothed  of the output
    error_mm  expected error of the fit, on which the smoothing depends
    size      of the hand relative to the skeleton, once it is known, otherwise None
    """

    fitted: WorldPose
    smoothed: WorldPose
    error_mm: float
    size: float | None


@dataclass(frozen=True, eq=False)
class HandPose:
    """The pose of one hand, or one other body, in one frame.

    skeleton    of a right hand; D DoFs, K joints
    side        "right" or "left"; "right" for other bodies
    inputs      (D,) of the skeleton: radians, and lengths in units; for a left hand, those of its
                mirror image; NaN without a fit
    bones       (K,) signed lengths in units, as ``Skeleton.bones``; NaN without a fit
    origin_mm   (3,) origin of the inputs, camera axes: the middle of its crop, for a left
                hand not mirrored
    xyz         (K, 3) mm, camera axes: x right, y up, z away
    center_uvd  (3,) px, px, mm: centre of its crop
    cube_mm     edge of that crop's cube
    raw_xyz     (K, 3) mm, likewise: the joints before smoothing; None if poses are not
                smoothed, or if unknown
    followed    before and after smoothing; None likewise
    surface     computes ``capsules``; None if they are unknown
    """

    skeleton: Skeleton = field(repr=False)
    side: Side
    inputs: Array
    bones: Array
    origin_mm: Array
    xyz: Array
    center_uvd: Array
    cube_mm: float
    raw_xyz: Array | None = None
    followed: TrackedPoses | None = None
    surface: Callable[[], Capsules] | None = field(default=None, repr=False)

    @cached_property
    def capsules(self) -> Capsules | None:
        """The surface in mm, camera axes; None if it is unknown."""
        return None if self.surface is None else self.surface()

    @cached_property
    def angles(self) -> dict[str, float]:
        """The anatomical angles by name, in degrees. Raises DataError (``anatomical_angles``)."""
        return anatomical_angles(self.skeleton, self.side, self.xyz)


@dataclass(frozen=True, eq=False)
class TrackedHand:
    """One hand in one frame: with a pose, or without one and with the reason. A hand that was
    reported before, and is not found in this frame, or not with enough confidence, is lost.

    id          of this hand, the same in all frames; from 0 in the order of first reports
    hand        "right" or "left"; None if it is unknown, only without a pose, and for other bodies
    confidence  probability that the joints' mean error is below 30 mm; NaN if it was not measured
    error_mm    expected error; NaN likewise
    pose        None if it is lost, or not sure enough to be reported
    reason      one line; empty with a pose
    presence    probability that it is a hand; NaN if unknown
    finger_error_mm  (5,) expected error of each finger, from the thumb on: mean over PIP joint, DIP
                     joint and tip; NaN where it is unknown
    side_confidence  probability that it is a ``hand``; below 1 while the side is undecided, and
                     ``hand`` is assumed
    other       the same hand as one of the other side, while the side is undecided
    gesture     that its joints show; None if it was not read
    place       (3,) mm, camera axes: the middle of a hand without a pose; NaN of a lost one
    since       s, when a lost hand was reported last; NaN for others
    mask        (height, width) the pixels of a hand without a pose in the last frame in which a
                finder looked for hands; None if unknown
    is_sure     False if there is little evidence that it is a hand; then it is not reported beside
                one with a pose
    is_seen     False if a finder looked since, and did not see it
    """

    id: int
    hand: Side | None
    confidence: float = math.nan
    error_mm: float = math.nan
    pose: HandPose | None = None
    reason: str = ""
    presence: float = math.nan
    finger_error_mm: Array = field(default_factory=unknown_finger_errors)
    side_confidence: float = 1.0
    other: TrackedHand | None = None
    gesture: Gesture | None = None
    place: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    since: float = math.nan
    mask: NDArray[np.bool_] | None = None
    is_sure: bool = True
    is_seen: bool = True

    @property
    def the_pose(self) -> HandPose:
        """The pose. Raises DataError without one."""
        if self.pose is None:
            raise DataError(f"hand {self.id} has no pose: {self.reason}")
        return self.pose

    @property
    def xyz(self) -> Array:
        """The joints (K, 3) in mm, camera axes. Raises DataError without a pose."""
        return self.the_pose.xyz

    @property
    def is_lost(self) -> bool:
        """True if it was reported before and is missing now."""
        return not math.isnan(self.since)

    @property
    def known_side(self) -> Side | None:
        """The side; None while it is undecided."""
        return self.hand if self.side_confidence >= 1 else None

    def without_pose(self, side: Side | None, place: Array, reason: str) -> TrackedHand:
        """The hand of this side at a place (3,) in mm, with a reason instead of its pose."""
        x, y, z = place.tolist()
        return replace(
            self,
            hand=side,
            side_confidence=1.0,
            pose=None,
            other=None,
            place=(x, y, z),
            reason=reason,
        )


class TrackedFrame(NamedTuple):
    """The hands of one frame.

    number  0-based, of the frame in its recording
    time    s; NaN if unknown, of single images
    every   all hands, those of each kind by id
    """

    number: int
    time: float
    every: tuple[TrackedHand, ...] = ()

    @property
    def hands(self) -> tuple[TrackedHand, ...]:
        """The hands with a pose."""
        return tuple(hand for hand in self.every if hand.pose is not None)

    @property
    def present(self) -> tuple[TrackedHand, ...]:
        """The hands that are there without a sure pose."""
        return tuple(hand for hand in self.every if hand.pose is None and not hand.is_lost)

    @property
    def lost(self) -> tuple[TrackedHand, ...]:
        """The hands reported before that are missing now."""
        return tuple(hand for hand in self.every if hand.is_lost)

    def with_gestures(self, reader: GestureReader) -> TrackedFrame:
        """The frame with the gesture of each pose, read after those of the frames before.

        Raises DataError (``GestureReader.read``).
        """
        every = []
        for hand in self.every:
            if hand.pose is not None:
                pose = hand.pose
                gesture = reader.read(hand.id, pose.side, pose.xyz, self.time, pose.angles)
                hand = replace(hand, gesture=gesture)
            every.append(hand)
        return self._replace(every=tuple(every))


def side_name(side: Side | None) -> str:
    """The side of a hand, or "unknown"."""
    return side or "unknown"


def joints_of(
    skeleton: Skeleton,
    unit_mm: float,
    hand: Side,
    inputs: ArrayLike,
    bones: ArrayLike,
    origin_mm: ArrayLike,
) -> Array:
    """Joints (K, 3) in mm, camera axes, of a hand with the fields of ``HandPose``."""
    posed = kinematics_of(skeleton).joints(
        np.asarray(inputs, np.float64)[None], np.asarray(bones, np.float64)[None]
    )[0]
    return posed * unit_mm * mirror_of(hand) + np.asarray(origin_mm, np.float64)
