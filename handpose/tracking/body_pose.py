"""The variables of a fitted body, independent of the crop in which it was fitted.

In ``WorldPose`` the root's position is in mm from the camera, and its orientation is one rotation: angles about three
axes are discontinuous at a pole, and do not measure angular speed. A left hand is in mirrored space, as in the fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.depth_fit.body import CapsuleModel
from handpose.tracking.one_euro import turn_between, turned
from layers.hand.kinematics import rotation
from netlib.blob import Array
from netlib.errors import NetlibError


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

    Raises NetlibError for a skeleton whose root does not translate along x, y, z and rotate about three different axes,
    with a free DoF each.
    """

    def __init__(self, model: CapsuleModel) -> None:
        whole = model.whole
        motions = whole.motions[int(np.flatnonzero(whole.parents < 0)[0])]
        slides = {m.axis: m for m in motions if m.kind == "translate"}
        turns = [m for m in motions if m.kind == "rotate"]
        column = {int(dof): i for i, dof in enumerate(model.free)}
        free = {m.dof for m in motions} & set(column)
        if set(slides) != {0, 1, 2} or {m.axis for m in turns} != {0, 1, 2} or len(motions) != 6 or len(free) != 6:
            raise NetlibError(
                f"skeleton {model.skeleton.name!r}: its root does not translate along x, y, z and turn about three "
                "axes, by a free DoF each, so that it cannot be followed through space"
            )
        self.unit_mm = model.unit_mm
        self._slides = np.array([column[slides[axis].dof] for axis in range(3)])
        self._slide_signs = np.array([slides[axis].sign for axis in range(3)])
        self._slide_initial = np.array([whole.initial[slides[axis].dof] for axis in range(3)])
        self._turns = np.array([column[m.dof] for m in turns])
        self._turn_signs = np.array([m.sign for m in turns])
        self._turn_initial = np.array([whole.initial[m.dof] for m in turns])
        self._axes = [m.axis for m in turns]
        i, j, _ = self._axes
        self._parity = 1.0 if (j - i) % 3 == 1 else -1.0
        self.others = np.setdiff1d(np.arange(model.variables), np.concatenate([self._slides, self._turns]))

    def world_pose(self, x: Array, center_mm: Array) -> WorldPose:
        """The body with x (V,) about the crop's centre (3,)."""
        theta = self._slide_signs * (x[self._slides] + self._slide_initial)
        return WorldPose(theta * self.unit_mm + center_mm, self.rotation(x), x[self.others])

    def rotation(self, x: Array) -> Array:
        """The root's rotation (3, 3) for x (V,)."""
        result = np.eye(3)
        for axis, angle in zip(self._axes, self._turn_signs * (x[self._turns] + self._turn_initial)):
            result = result @ rotation(axis, angle)
        return result

    def variables(self, body: WorldPose, center_mm: Array) -> Array:
        """x (V,) about the crop's centre (3,), with the root's angles between -pi and pi."""
        x = np.empty(len(self.others) + 6)
        x[self.others] = body.others
        x[self._slides] = (body.place - center_mm) / self.unit_mm * self._slide_signs - self._slide_initial
        angles = self._turn_signs * self._angles(body.rotation) - self._turn_initial
        x[self._turns] = (angles + np.pi) % (2 * np.pi) - np.pi
        return x

    def _angles(self, R: Array) -> Array:
        """The angles (3,) of R = R_i(a) R_j(b) R_k(c) with the root's axes i, j, k."""
        i, j, k = self._axes
        e = self._parity
        b = np.arcsin(np.clip(e * R[i, k], -1, 1))
        if abs(R[i, k]) > 1 - 1e-12:  # only the sum of the other angles is determined
            return np.array([np.arctan2(e * R[k, j], R[j, j]), b, 0.0])
        return np.array([np.arctan2(-e * R[j, k], R[k, k]), b, np.arctan2(-e * R[i, j], R[i, i])])


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
