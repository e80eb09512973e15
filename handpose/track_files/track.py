"""Hands over time: what a tracker tells of every frame, and what a synthetic recording knows of its own.

A hand is inputs of the skeleton, its bones, and an origin. Of a left hand the inputs are those of its mirror image, a
right hand: ``joints_of`` turns all of it into joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from handpose.facts.cameras import Camera
from handpose.facts.nyu import CUBE_MM
from handpose.facts.sides import Side, mirror_of
from handpose.surface.render import Capsules
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


@dataclass(frozen=True)
class TrackHeader:
    """What holds for all frames.

    source    the recording's name
    camera    that saw it, without distortion
    skeleton  the body, of a right hand; D DoFs, K joints
    unit_mm   what a length of 1 in inputs and skeleton stands for
    smoothed  were poses smoothed over time?
    """

    source: str
    camera: Camera
    skeleton: Skeleton
    unit_mm: float = CUBE_MM / 2
    smoothed: bool = True


@dataclass(frozen=True)
class TrackedHand:
    """One hand in one frame.

    id          of this hand, the same in all frames
    hand        "right" or "left"
    confidence  the chance that the joints' mean error is below 30 mm; NaN if nobody has measured it
    error_mm    the error to be expected; NaN likewise
    inputs      (D,) of the skeleton: radians, and lengths in units; of a left hand, those of its mirror image
    bones       (K,) signed lengths in units, as ``Skeleton.bones``
    origin_mm   (3,) where the inputs' origin is, camera axes: the middle of its crop, of a left hand not mirrored
    xyz         (K, 3) mm, camera axes: x right, y up, z away
    center_uvd  (3,) px, px, mm: the middle of the crop in which it was seen
    cube_mm     edge of that crop's cube
    capsules    its flesh in mm, camera axes, of one body; None where nobody knows
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


class LostHand(NamedTuple):
    """A hand that was tracked and is not found in this frame.

    since   s, when it was seen last
    reason  one line, in words
    """

    id: int
    hand: Side
    since: float
    reason: str


class TrackedFrame(NamedTuple):
    """What is told of one frame.

    number  0-based, of the frame in its recording
    time    s
    hands   those that are seen, by id
    lost    those that were seen before and are not now, by id
    """

    number: int
    time: float
    hands: tuple[TrackedHand, ...]
    lost: tuple[LostHand, ...] = ()


def joints_of(
    skeleton: Skeleton, unit_mm: float, hand: Side, inputs: ArrayLike, bones: ArrayLike, origin_mm: ArrayLike
) -> Array:
    """Joints (K, 3) in mm, camera axes, of a hand with the fields of ``TrackedHand``."""
    posed = kinematics_of(skeleton).joints(np.asarray(inputs, np.float64)[None], np.asarray(bones, np.float64)[None])[0]
    return np.asarray(posed * unit_mm * mirror_of(hand) + np.asarray(origin_mm, np.float64))
