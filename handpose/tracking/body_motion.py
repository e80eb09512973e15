"""The motion of a body between frames, in space."""

from __future__ import annotations

from typing import NamedTuple

from handpose.fit.world_pose import WorldPose
from handpose.tracking.one_euro import turn_between, turned
from netlib.blob import Array


class Motion(NamedTuple):
    """The velocity of a body: mm/s, rad/s about the world's axes, and its other variables per second."""

    place: Array
    turn: Array
    others: Array


def motion_between(first: WorldPose, second: WorldPose, seconds: float) -> Motion:
    """The motion from one body to the other in this time."""
    return Motion(
        (second.place - first.place) / seconds,
        turn_between(first.rotation, second.rotation) / seconds,
        (second.others - first.others) / seconds,
    )


def moved(body: WorldPose, motion: Motion, seconds: float) -> WorldPose:
    """The body after this time."""
    return WorldPose(
        body.place + motion.place * seconds,
        turned(body.rotation, motion.turn * seconds),
        body.others + motion.others * seconds,
    )
