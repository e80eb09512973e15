"""Position and rotation of a body's root, which are spread over six variables of a fit.

Angles about three axes are discontinuous at a pole. So whatever moves a body as a whole works with a rotation matrix,
and converts it to the variables last.
"""

from __future__ import annotations

import numpy as np

from handpose.depth_fit.body import CapsuleModel
from layers.hand.kinematics import rotation
from netlib.blob import Array
from netlib.errors import NetlibError


class RootMotion:
    """Converts between variables x (N, V) and the root's position and rotation.

    columns  (6,) of x: three translations along x, y, z, and three rotations in their order

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
        ordered = [slides[axis] for axis in range(3)] + turns
        self.columns = np.array([column[m.dof] for m in ordered])
        self._signs = np.array([m.sign for m in ordered], dtype=float)
        self._signs[:3] *= model.unit_mm
        self._initial = np.array([whole.initial[m.dof] for m in ordered])
        self._axes = [m.axis for m in turns]
        i, j, _ = self._axes
        self._parity = 1.0 if (j - i) % 3 == 1 else -1.0

    def place(self, x: Array) -> Array:
        """The root's position (N, 3) in mm from the crop's centre."""
        return np.asarray((x[:, self.columns[:3]] + self._initial[:3]) * self._signs[:3])

    def rotation(self, x: Array) -> Array:
        """The root's rotation world_from_root (N, 3, 3)."""
        angles = (x[:, self.columns[3:]] + self._initial[3:]) * self._signs[3:]
        first, second, third = (rotation(axis, angle) for axis, angle in zip(self._axes, angles.T))
        return np.asarray(first @ second @ third)

    def variables(self, place: Array, R: Array) -> Array:
        """The variables (N, 6) of ``columns`` for positions (N, 3) and rotations (N, 3, 3); angles in [-pi, pi)."""
        x = np.concatenate([place, self._angles(R)], axis=1) / self._signs - self._initial
        x[:, 3:] = (x[:, 3:] + np.pi) % (2 * np.pi) - np.pi
        return np.asarray(x)

    def _angles(self, R: Array) -> Array:
        """The angles (N, 3) of R = R_i(a) R_j(b) R_k(c) with the root's axes i, j, k."""
        (i, j, k), e = self._axes, self._parity
        pole = np.abs(R[:, i, k]) > 1 - 1e-12  # only the sum of the other angles is determined
        a = np.where(pole, np.arctan2(e * R[:, k, j], R[:, j, j]), np.arctan2(-e * R[:, j, k], R[:, k, k]))
        b = np.arcsin(np.clip(e * R[:, i, k], -1, 1))
        c = np.where(pole, 0.0, np.arctan2(-e * R[:, i, j], R[:, i, i]))
        return np.stack([a, b, c], axis=1)
