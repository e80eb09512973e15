"""Exercise: the forward kinematics of a hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from exercises import hand, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values
from layers.hand import kinematics
from netlib.blob import Array

AXES = {
    "joints": "pose joint xyz",
    "frames": "pose joint row column",
    "axis": "pose motion xyz",
    "pivot": "pose motion xyz",
    "Rx": "row column",
    "Ry": "angle row column",
    "Rz": "angle row column",
}


ANGLES = np.array([0.0, 0.5, -1.2])


def _rotations(part: Part) -> Values:
    """Return Rx (3, 3) for one angle in rad, Ry and Rz (3, 3, 3) for three."""
    found = {"Rx": part.rotation(0, 0.5), "Ry": part.rotation(1, ANGLES)}
    return found | {"Rz": part.rotation(2, ANGLES)}


def _finger(part: Part, *names: str, bones: Array | None = None) -> Values:
    """Return attributes of the Pose of the finger in its two poses, by name."""
    pose = part.Kinematics(hand.FINGER).forward(hand.POSES, bones)
    return {name: getattr(pose, name) for name in names}


def _case(title: str, run: Callable[[Part], Values], method: str = "forward") -> Case:
    """Return a case whose expected results are those of the project's functions."""
    return Case(title, run, lambda: run(kinematics), "expected", AXES, 1e-12, method)


def _nyus_joints(part: Part) -> Values:
    """Return the joints (N, K, 3) of the paper's hand in the recorded poses."""
    poses = recorded.everything()["hand_model/bottom"]
    return {"joints": part.Kinematics(hand.NYU).forward(poses).joints}


def _recorded_joints() -> Values:
    return {"joints": recorded.everything()["hand_model/top_f64"].reshape(4, -1, 3)}


ROTATION = """R[..., i, i], R[..., i, j] = cos, -sin
R[..., j, i], R[..., j, j] = sin, cos"""
BACKWARDS = """R[..., i, i], R[..., i, j] = cos, sin
R[..., j, i], R[..., j, j] = -sin, cos"""
TURNED_BACKWARDS = Mistake(
    "The rotation has the wrong direction: the minus belongs to the sine in the first row, of (x, y) for z, "
    "(y, z) for x, (z, x) for y.",
    (ROTATION, BACKWARDS),
)
MATRICES_EXCHANGED = Mistake(
    "The matrices are multiplied in the wrong order. A joint rotates about its own axes, already moved by the "
    "previous rotations: F <- F R, not R F.",
    (
        "F @ rotation(motion.axis, motion.sign * theta[:, motion.dof])",
        "rotation(motion.axis, motion.sign * theta[:, motion.dof]) @ F",
    ),
)
SIGN_IGNORED = Mistake(
    "motion.sign is ignored: NEG_Y is a rotation about -y, that is, about y by -theta.",
    ("motion.sign * theta[:, motion.dof]", "theta[:, motion.dof]"),
)
ROW_FOR_COLUMN = Mistake(
    "F[:, axis] is a row of F. F e_axis is a column: F[:, :, axis].",
    ("F[:, :, motion.axis]", "F[:, motion.axis]"),
)
PARENT_MOVED = Mistake(
    "p += ... also changes the parent's joint: p is a view of pose.joints[:, parent]. Write p = p + ..., which"
    " creates a new array.",
    ("p = p + a * theta[:, motion.dof, None]", "p += a * theta[:, motion.dof, None]"),
)
MISTAKES = (TURNED_BACKWARDS, MATRICES_EXCHANGED, SIGN_IGNORED, ROW_FOR_COLUMN, PARENT_MOVED)

BONES = np.outer([1, 2], hand.FINGER.bones)
TO_DO = {
    "Kinematics.forward": "Return the Pose of each row of inputs, Pose(N, K, len(skeleton.driven)). theta = "
    "self.skeleton.theta(inputs) has the DoF values, (N, D), with fixed DoFs and initial values applied. Loop "
    "over skeleton.order, parents first. A joint starts at its parent's pose.joints and pose.frames (a root, "
    "whose skeleton.parents is -1: at 0, with the identity). Apply skeleton.motions[j] in their order: "
    "motion.kind, .axis, .sign, .dof. Then write pose.joints[:, j] and pose.frames[:, j]; skeleton.bones and "
    ".bone_axes describe each joint's bone; bones, if given, replaces the lengths. Where motion.row >= 0, write "
    "pose.axis[:, row] and pose.pivot[:, row] before the motion is applied: its axis in world coordinates, with "
    "the sign, and the current point p of the joint. backward needs them.",
    "rotation": "Return R for every angle: the standard rotation matrices. About z, x rotates to y; about x, y to "
    "z; about y, z to x. For axis 2, z, R is [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]].",
}

ROTATIONS = _case("angle 0.5 for x, an array of angles for y and z", _rotations, "rotation")
TWO_POSES = _case("two poses", lambda part: _finger(part, "frames", "joints"))
LENGTHS = _case("bones given", lambda part: _finger(part, "joints", bones=BONES))
MOTIONS = _case("two poses", lambda part: _finger(part, "axis", "pivot"))
NYUS_HAND = Case("NYU's hand", _nyus_joints, _recorded_joints, "Caffe has", AXES, 1e-12, "forward")

CHECKS = (
    Check("values: a rotation about each axis", (ROTATIONS,)),
    Check("values: a finger with three joints", (TWO_POSES, LENGTHS)),
    Check("values: the axes and pivots of its motions", (MOTIONS,)),
    Check("values: Caffe's recorded hand poses", (NYUS_HAND,)),
)

EXERCISE = Exercise(
    name="joint_transform",
    title="Joint transforms: from angles to positions",
    chapter=8,
    file="layers/hand/kinematics.py",
    to_do=TO_DO,
    checks=CHECKS,
    mistakes=MISTAKES,
    train=hand.losses,
)
