"""The variables of a fitted body, independent of the crop in which it was fitted.

In ``WorldPose`` the root's position is in mm from the camera, and its orientation is one rotation: angles about three
axes are discontinuous at a pole, and do not measure angular speed. A left hand is in mirrored space, as in the fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.fit.body import CapsuleModel, RootMotion
from handpose.tracking.one_euro import turn_between, turned
from netlib.blob import Array


class WorldPose(NamedTuple):
    """A body in space.

    place     (3,) mm, position of the root in the axes of the (mirrored) camera
    rotation  (3, 3) world_from_root
    others    (V - 6,) the other variables: limbs, the surface's own, logarithms of size and thickness
    """

    place: Array
    rotation: Array
    others: Array


class PoseConverter:
    """Converts between variables x (V,) about a crop's centre and ``WorldPose``.

    Raises NetlibError for a root that ``RootMotion`` does not accept.
    """

    def __init__(self, model: CapsuleModel) -> None:
        self._root = RootMotion(model)
        self.others = np.setdiff1d(np.arange(model.variables), self._root.columns)

    def world_pose(self, x: Array, center_mm: Array) -> WorldPose:
        """The body with x (V,) about the crop's centre (3,)."""
        rows = x[None]
        return WorldPose(self._root.place(rows)[0] + center_mm, self._root.rotation(rows)[0], x[self.others])

    def variables(self, body: WorldPose, center_mm: Array) -> Array:
        """x (V,) about the crop's centre (3,), with the root's angles between -pi and pi."""
        x = np.empty(len(self.others) + 6)
        x[self.others] = body.others
        x[self._root.columns] = self._root.variables((body.place - center_mm)[None], body.rotation[None])[0]
        return x


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
