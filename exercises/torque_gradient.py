"""Exercise: the gradient of joint positions from torques."""

from __future__ import annotations

import numpy as np

from exercises import hand, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values
from exercises.layers import numbers
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

AXES = {"dtheta": "pose dof", "dX (after backward)": "pose joint xyz"}
STEP = 1e-6  # of the differences, in rad or in units of length


def _run(part: Part, skeleton: Skeleton, inputs: Array, dX: Array) -> Values:
    """Return dtheta (N, D) of dX (N, K, 3), which backward must not change."""
    kinematics = part.Kinematics(skeleton)
    given = dX.copy()
    return {
        "dtheta": kinematics.backward(kinematics.forward(inputs), given),
        "dX (after backward)": given,
    }


def _differences(dX: Array) -> Values:
    """Return dtheta (2, D) of the finger by central differences of sum dX . X, dX (2, 3, 3)."""
    kinematics = Kinematics(hand.FINGER)

    def value(moved: Array) -> Array:
        return np.asarray((kinematics.forward(moved).joints * dX).sum(axis=(1, 2)))

    poses = hand.POSES
    dtheta = np.zeros(poses.shape)
    for d, step in enumerate(np.eye(poses.shape[1]) * STEP):
        above, below = value(poses + step), value(poses - step)
        dtheta[:, d] = (above - below) / (2 * STEP)
    return {"dtheta": dtheta, "dX (after backward)": dX}


def _by_differences(title: str, *joints: int) -> Case:
    """Return the case of forces on some joints of the finger, in its two poses."""
    dX = np.zeros((2, 3, 3))
    dX[:, joints] = numbers(2, len(joints), 3)
    return Case(
        title,
        lambda part: _run(part, hand.FINGER, hand.POSES, dX),
        lambda: _differences(dX),
        "finite differences give",
        AXES,
        1e-7,
        "backward",
    )


def _nyus_dtheta(part: Part) -> Values:
    """Return dtheta (N, D) of the paper's hand for the recorded poses and top diffs."""
    arrays = recorded.everything()
    dX = arrays["hand_model/top_diff"].astype(np.float64)
    return _run(part, hand.NYU, arrays["hand_model/bottom"], dX.reshape(len(dX), -1, 3))


def _recorded_dtheta() -> Values:
    return {"dtheta": recorded.everything()["hand_model/bottom_diff_f64"]}


CROSS_EXCHANGED = Mistake(
    "The cross product has the wrong order: a torque is lever x force, (X - P) x f.",
    ("np.cross(X[:, j] - P, force[:, j])", "np.cross(force[:, j], X[:, j] - P)"),
)
LEVER_IGNORED = Mistake(
    "The child's torque is about the child, not about its parent: add (X_c - X_j) x force_c.",
    ("torque[:, j] + np.cross(lever, force[:, j])", "torque[:, j]"),
)
DOF_ASSIGNED = Mistake(
    "A DoF may drive several motions; its gradient is the sum over them: dtheta[:, dof] += ...",
    (
        "dtheta[:, motion.dof] += (a * generalized_force).sum(axis=1)",
        "dtheta[:, motion.dof] = (a * generalized_force).sum(axis=1)",
    ),
)
PARENTS_FIRST = Mistake(
    "The joints are visited from the root to the tips. Visit children before parents: "
    "reversed(skeleton.order).",
    ("reversed(sk.order)", "sk.order"),
)
DX_CHANGED = Mistake(
    "dX is modified: it belongs to the next layer. Sum the forces in a copy.",
    ("np.array(dX, dtype=np.float64)", "dX"),
)
MISTAKES = (CROSS_EXCHANGED, LEVER_IGNORED, DOF_ASSIGNED, PARENTS_FIRST, DX_CHANGED)

TO_DO = {
    "Kinematics.backward": "Return dtheta (N, len(skeleton.initial)) in self.dtype. Begin with force = a float64 "
    "copy of dX and torque = 0, and loop over reversed(skeleton.order), so that a joint contains the sums of its "
    "children before it is visited. For each of its motions with motion.row >= 0 (the others are fixed) add to "
    "dtheta[:, motion.dof]; a is pose.axis[:, row], P is pose.pivot[:, row], and a DoF may drive several motions. "
    "Then add the joint's force and torque to its parent's. np.cross(u, v) works along the last axis."
}

FORCES = (
    _by_differences("a force on the base alone", 0),
    _by_differences("a force on the middle alone", 1),
    _by_differences("a force on the tip alone", 2),
    _by_differences("forces on all joints", 0, 1, 2),
)
NYUS_HAND = Case("NYU's hand", _nyus_dtheta, _recorded_dtheta, "Caffe has", AXES, 1e-11, "backward")

CHECKS = (
    Check("gradient: a finger, against finite differences", FORCES),
    Check("gradient: Caffe's recorded hand poses", (NYUS_HAND,)),
)

EXERCISE = Exercise(
    name="torque_gradient",
    title="The torque gradient: from forces on joints to angles",
    chapter=9,
    file="layers/hand/kinematics.py",
    to_do=TO_DO,
    checks=CHECKS,
    mistakes=MISTAKES,
    train=hand.losses,
)
