"""Starts of a depth fit from joints that a network predicts.

Joints predicted one by one are more accurate than those of predicted angles, but they need not be
joints of the body. So the body with the predicted angles is moved to the predicted joints of its
palm (Kabsch), and the start is the x that minimises, with x_0 from the predicted angles and size,

    |X(x) - joints|^2 / joint_mm^2  +  sum over limbs of (x - x_0)^2 / limb^2
        +  (log size - log size_0)^2 / size_std^2

by Levenberg-Marquardt. Without the alignment,
Levenberg-Marquardt converges slowly where the predicted rotation is far off: after twice as many
steps it is farther from the joints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.search import minimise
from handpose.fit.settings import JointStartSettings
from netlib.blob import Array
from netlib.errors import NetlibError

START_RIDGE = 1e-9


def near_joints(
    model: CapsuleModel, x: Array, joints: Array, settings: JointStartSettings
) -> Array:
    """Fit bodies x (N, V) to joints (N, K, 3) in mm; variables that the surface alone has
    are not changed.
    """
    found = aligned(model, x, joints)
    problem = _NearJoints(model, found, joints, settings)
    columns = problem.columns
    lower, upper = model.lower[columns], model.upper[columns]
    start = found[:, columns]
    found[:, columns], _ = minimise(
        problem.evaluate, start, lower, upper, settings.steps, ridge=START_RIDGE
    )
    return found


class _NearJoints:
    """The cost of bodies near joints, relative to its unit.

    columns  the variables that move the skeleton, and the size
    """

    def __init__(
        self, model: CapsuleModel, x: Array, joints: Array, settings: JointStartSettings
    ) -> None:
        self._model = model
        self._start = x
        skeleton = model.skeleton
        free = np.unique(skeleton.driven)
        self._sums = (skeleton.driven[:, None] == free).astype(float)
        self._root = int(np.flatnonzero(skeleton.parents < 0)[0])
        self.columns = np.append(np.searchsorted(model.free, free), model.variables + SIZE_INDEX)
        is_limb = np.isin(self.columns, model.limbs)
        self._precision = np.where(is_limb, settings.limb**-2.0, 0.0)
        self._precision[-1] = settings.size_std**-2.0
        self._unit = settings.joint_mm / model.unit_mm
        self._goal = joints / model.unit_mm

    def evaluate(self, x: Array, rows: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        """Cost (n,), normal matrix (n, F, F) and half gradient (n, F) of the columns x (n, F) of
        some bodies.
        """
        model = self._model
        skeleton = self._model.skeleton
        trial = self._start[rows]
        trial[:, self.columns] = x
        bones = skeleton.bones * np.exp(trial[:, [SIZE_INDEX]])
        pose = model.kinematics.forward_pose(model.inputs_of(trial), bones)
        grows = (pose.joints - pose.joints[:, [self._root]]).reshape(len(trial), 1, -1)
        turns = self._sums.T @ model.kinematics.jacobian(pose)
        J = np.concatenate([turns, grows], axis=1) / self._unit
        r = (pose.joints - self._goal[rows]).reshape(len(trial), -1, 1) / self._unit
        off = x - self._start[rows][:, self.columns]
        diagonal = np.arange(len(self.columns))
        A = J @ J.swapaxes(1, 2)
        A[:, diagonal, diagonal] += self._precision
        b = (J @ r)[..., 0] + self._precision * off
        pull = (self._precision * off * off).sum(axis=1)
        return (r * r).sum(axis=(1, 2)) + pull, A, b


def aligned(model: CapsuleModel, x: Array, joints: Array) -> Array:
    """Move bodies x (N, V) as a whole, so that joints fixed to the root are closest to joints
    (N, K, 3) in mm.

    Kabsch, "A solution for the best rotation to relate two sets of vectors" (1976). A body whose
    root has fewer than six DoFs is not moved.
    """
    x = x.copy()
    try:
        root = model.root_motion
    except NetlibError:
        return x
    limbs = ~np.isin(model.skeleton.driven, model.free[model.root])
    rigid = ~model.skeleton.moves[limbs].any(axis=0)
    own, goal = model.joints(x)[:, rigid], joints[:, rigid]
    middle, goal_middle = own.mean(axis=1), goal.mean(axis=1)
    centred, goal_centred = own - middle[:, None], goal - goal_middle[:, None]
    U, _, V = np.linalg.svd(centred.swapaxes(1, 2) @ goal_centred)
    V[:, 2] *= np.sign(np.linalg.det(U @ V))[:, None]  # a rotation, no reflection
    turn = (U @ V).swapaxes(1, 2)
    place = goal_middle + (turn @ (root.place(x) - middle)[..., None])[..., 0]
    x[:, root.columns] = root.variables(place, turn @ root.rotation(x))
    return np.clip(x, model.lower, model.upper)
