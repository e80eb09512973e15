"""Tracks of hands: what a tracker outputs for every frame, and the truth of a synthetic recording.

A hand has inputs of the skeleton, bones, and an origin. The inputs of a left hand are those of its
mirror image, a right hand; ``joints_of`` computes its joints.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.render import Capsules
from handpose.body.sides import Side, mirror_of
from handpose.fit.body import WorldPose
from handpose.fit.pose_confidence import unknown_finger_errors
from handpose.frames.cameras import Camera
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

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


@dataclass(frozen=True)
class TrackedHand:
    """One hand in one frame.

    id          of this hand, the same in all frames; from 0 in the order of first reports
    hand        "right" or "left"
    confidence  probability that the joints' mean error is below 30 mm; NaN if it was not measured
    error_mm    expected error; NaN likewise
    inputs      (D,) of the skeleton: radians, and lengths in units; for a left hand, those of its
                mirror image; NaN without a fit
    bones       (K,) signed lengths in units, as ``Skeleton.bones``; NaN without a fit
    origin_mm   (3,) origin of the inputs, camera axes: the middle of its crop, for a left
                hand not mirrored
    xyz         (K, 3) mm, camera axes: x right, y up, z away
    center_uvd  (3,) px, px, mm: centre of its crop
    cube_mm     edge of that crop's cube
    capsules    its surface in mm, camera axes; None if unknown
    side_confidence  probability that it is a ``hand``; below 1 while the side is undecided, and
                     ``hand`` is assumed
    other       the same hand as one of the other side, while the side is undecided
    finger_error_mm  (5,) expected error of each finger, from the thumb on: mean over PIP joint, DIP
                     joint and tip; NaN
                where it is unknown
    raw_xyz     (K, 3) mm, likewise: the joints before smoothing; None if poses are not
                smoothed, or if unknown
    poses       before and after smoothing; None likewise
    presence    probability that it is a hand; NaN if unknown
    """

    id: int
    hand: Side
    confidence: float
    error_mm: float
    inputs: Array
    bones: Array
    origin_mm: Array
    xyz: Array
    center_uvd: Array
    cube_mm: float
    capsules: Capsules | None = None
    side_confidence: float = 1.0
    other: TrackedHand | None = None
    finger_error_mm: Array = field(default_factory=unknown_finger_errors)
    raw_xyz: Array | None = None
    poses: TrackedPoses | None = None
    presence: float = float("nan")

    @property
    def palm_mm(self) -> Array:
        """The middle (3,) of the hand."""
        return np.asarray(self.xyz.mean(axis=0))

    @property
    def known_side(self) -> Side | None:
        """The side; None while it is undecided."""
        return self.hand if self.side_confidence >= 1 else None


class LostHand(NamedTuple):
    """A hand that was reported before, and is not found in this frame, or not with
    enough confidence.

    hand    None if its side was never decided
    since   s, when it was reported last
    reason  one line
    """

    id: int
    hand: Side | None
    since: float
    reason: str


class PresentHand(NamedTuple):
    """A hand that is there, but whose pose is not sure enough to be reported.

    hand        None if its side is not known
    presence    probability that it is a hand; NaN if unknown
    confidence  of its pose
    place       (3,) mm, camera axes: its middle
    reason      one line
    mask        (height, width) its pixels in the last frame in which a finder looked for hands;
                None if unknown
    is_sure     False if only a low presence says that it is a hand; then it is not reported beside
                one with joints
    is_seen     False if a finder looked since, and did not see it
    """

    id: int
    hand: Side | None
    presence: float
    confidence: float
    place: tuple[float, float, float]
    reason: str
    mask: NDArray[np.bool_] | None = None
    is_sure: bool = True
    is_seen: bool = True


class TrackedFrame(NamedTuple):
    """The hands of one frame.

    number  0-based, of the frame in its recording
    time    s; NaN if unknown, of single images
    hands   the tracked hands with their poses, by id
    lost    hands reported before that are missing now, by id
    present  hands that are there without a sure pose, by id
    """

    number: int
    time: float
    hands: tuple[TrackedHand, ...]
    lost: tuple[LostHand, ...] = ()
    present: tuple[PresentHand, ...] = ()


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
    """Joints (K, 3) in mm, camera axes, of a hand with the fields of ``TrackedHand``."""
    posed = kinematics_of(skeleton).joints(
        np.asarray(inputs, np.float64)[None], np.asarray(bones, np.float64)[None]
    )[0]
    return np.asarray(posed * unit_mm * mirror_of(hand) + np.asarray(origin_mm, np.float64))
