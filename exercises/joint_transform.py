"""Exercise: the forward kinematics of a hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from exercises import hand, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Progress, Values, advice_of
from layers.hand import kinematics as source
from layers.hand.kinematics import Kinematics, Pose
from layers.hand.skeleton import Motion
from netlib.blob import Array

Rotation = Callable[[int, Any], Array]
AXES = {
    "joints": ("pose", "joint", "xyz"),
    "frames": ("pose", "joint", "row", "column"),
    "axis": ("pose", "motion", "xyz"),
    "pivot": ("pose", "motion", "xyz"),
    **{f"R{axis}": ("angle", "row", "column") for axis in "xyz"},
}


@dataclass(frozen=True)
class Transform:
    """The part: the class and the rotation function of its module."""

    kinematics: type[Kinematics]
    rotation: Rotation


def _rotations(part: Transform) -> Values:
    angles = np.array([0.0, 0.5, -1.2])
    return {f"R{name}": part.rotation(axis, angles) for axis, name in enumerate("xyz")}


def _finger(part: Transform) -> Values:
    skeleton = hand.finger()
    pose = part.kinematics(skeleton).forward(hand.poses(skeleton))
    return {"frames": pose.frames, "joints": pose.joints}


def _motions(part: Transform) -> Values:
    skeleton = hand.finger()
    pose = part.kinematics(skeleton).forward(hand.poses(skeleton))
    return {"axis": pose.axis, "pivot": pose.pivot}


def _other_bones(part: Transform) -> Values:
    skeleton = hand.finger()
    bones = skeleton.bones * np.array([[1.0], [2.0]])
    return {"joints": part.kinematics(skeleton).forward(hand.poses(skeleton), bones).joints}


def _caffe(part: Transform) -> Values:
    joints = part.kinematics(hand.nyu_hand()).forward(recorded.everything()["hand_model/bottom"]).joints
    return {"joints": joints}


REFERENCE = Transform(Kinematics, source.rotation)


def _case(title: str, run: Callable[[Transform], Values], method: str = "forward") -> Case:
    return Case(title, run, lambda: run(REFERENCE), "expected", AXES, 1e-12, method)


def _caffes() -> Values:
    top = recorded.everything()["hand_model/top_f64"]
    return {"joints": top.reshape(len(top), -1, 3)}


# ---------------------------------------------------------------------------------------------- mistakes


class _Walk(Kinematics):
    """forward split into methods; each subclass breaks one."""

    rotation: Rotation = staticmethod(source.rotation)

    def theta(self, inputs: Array) -> Array:
        return self.skeleton.theta(inputs)

    def start(self, pose: Pose, j: int, count: int) -> tuple[Array, Array]:
        parent = self.skeleton.parents[j]
        if parent < 0:
            return np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
        return pose.joints[:, parent], pose.frames[:, parent]

    def motions(self, j: int) -> list[Motion]:
        return list(self.skeleton.motions[j])

    def axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * F[:, :, motion.axis])

    def recorded_axis(self, F: Array, motion: Motion) -> Array:
        return self.axis(F, motion)

    def turned(self, F: Array, motion: Motion, angle: Array) -> Array:
        return np.asarray(F @ self.rotation(motion.axis, motion.sign * angle))

    def bone_frame(self, F: Array, before: Array) -> Array:
        return F

    def pivot(self, p: Array, start: Array, end: Array) -> Array:
        return p

    def forward(self, inputs: Array, bones: Array | None = None) -> Pose:
        sk, theta = self.skeleton, self.theta(inputs)
        N, K = len(theta), len(sk.bones)
        lengths = np.broadcast_to(self.lengths(bones), (N, K))
        pose = Pose(N, K, len(sk.driven))
        for j in sk.order:
            p, F = self.start(pose, j, N)
            begin, before, pivots = p, F, []
            for motion in self.motions(j):
                if motion.row >= 0:
                    pose.axis[:, motion.row] = self.recorded_axis(F, motion)
                    pivots.append((motion.row, p))
                if motion.kind == "translate":
                    p = p + self.axis(F, motion) * theta[:, motion.dof, None]
                else:
                    F = self.turned(F, motion, theta[:, motion.dof])
            along = self.bone_frame(F, before)[:, :, sk.bone_axes[j]]
            pose.joints[:, j], pose.frames[:, j] = p + along * lengths[:, j, None], F
            for row, pivot in pivots:
                pose.pivot[:, row] = self.pivot(pivot, begin, pose.joints[:, j])
        return pose

    def lengths(self, bones: Array | None) -> Array:
        return self.skeleton.bones if bones is None else bones


def _transposed(axis: int, angle: Any) -> Array:
    return source.rotation(axis, -np.asarray(angle))


def _y_mirrored(axis: int, angle: Any) -> Array:
    return source.rotation(axis, -np.asarray(angle) if axis == 1 else angle)


def _degrees(axis: int, angle: Any) -> Array:
    return source.rotation(axis, np.radians(angle))


class _Transposed(_Walk):
    """The rotation has the wrong direction: the minus belongs to the sine in the first row, of (x, y) for z, (y, z) for
    x, (z, x) for y.
    """

    rotation = staticmethod(_transposed)


class _YMirrored(_Walk):
    """The rotation about y has the wrong direction; the other two are correct. The cyclic order after y is z, x, so the
    minus is in the row of z, below the diagonal.
    """

    rotation = staticmethod(_y_mirrored)


class _Degrees(_Walk):
    """The angles are in radians already."""

    rotation = staticmethod(_degrees)


class OnTheLeft(_Walk):
    """The matrices are multiplied in the wrong order. A joint rotates about its own axes, already moved by the previous
    rotations: F <- F R, not R F.
    """

    def turned(self, F: Array, motion: Motion, angle: Array) -> Array:
        return np.asarray(self.rotation(motion.axis, motion.sign * angle) @ F)


class ForgetsSign(_Walk):
    """motion.sign is ignored: NEG_Y is a rotation about -y, that is, about y by -theta."""

    def turned(self, F: Array, motion: Motion, angle: Array) -> Array:
        return np.asarray(F @ self.rotation(motion.axis, angle))


class ForgetsSignOfAxis(_Walk):
    """pose.axis ignores the sign: the axis of a rotation about -y is -F e_y."""

    def recorded_axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(F[:, :, motion.axis])


class SlidesInWorld(_Walk):
    """The translation follows the world axes. It must follow the joint's own axis: F e_axis, a column of F."""

    def axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * np.broadcast_to(np.eye(3)[motion.axis], (len(F), 3)))

    def recorded_axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * F[:, :, motion.axis])


class TakesRows(_Walk):
    """F[:, axis] is a row of F. F e_axis is a column: F[:, :, axis]."""

    def axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * F[:, motion.axis])


class BoneBeforeTurn(_Walk):
    """The bone follows the parent's frame. Apply it after the rotations: use the joint's own F."""

    def bone_frame(self, F: Array, before: Array) -> Array:
        return before


class OtherOrder(_Walk):
    """The motions are applied in the wrong order; use that of skeleton.motions[j]."""

    def motions(self, j: int) -> list[Motion]:
        return list(self.skeleton.motions[j])[::-1]


class StartsAtOrigin(_Walk):
    """Every joint starts at the origin. It starts where its parent is: pose.joints[:, parent]."""

    def start(self, pose: Pose, j: int, count: int) -> tuple[Array, Array]:
        _, F = super().start(pose, j, count)
        return np.zeros((count, 3)), F


class ForgetsFrame(_Walk):
    """Every joint starts with the identity. It starts with its parent's frame: pose.frames[:, parent]."""

    def start(self, pose: Pose, j: int, count: int) -> tuple[Array, Array]:
        p, _ = super().start(pose, j, count)
        return p, np.broadcast_to(np.eye(3), (count, 3, 3))


class ChangesParent(_Walk):
    """p += ... also changes the parent's joint: p is a view of pose.joints[:, parent]. Write p = p + ..., which creates
    a new array.
    """

    def forward(self, inputs: Array, bones: Array | None = None) -> Pose:
        pose = super().forward(inputs, bones)
        sk, theta = self.skeleton, self.theta(inputs)
        joints = np.zeros(pose.joints.shape)
        for j in sk.order:
            p, F = self.start(pose, j, len(theta))
            p = joints[:, sk.parents[j]] if sk.parents[j] >= 0 else p
            for motion in sk.motions[j]:
                if motion.kind == "translate":
                    p += self.axis(F, motion) * theta[:, motion.dof, None]
                else:
                    F = self.turned(F, motion, theta[:, motion.dof])
            joints[:, j] = p + F[:, :, sk.bone_axes[j]] * self.lengths(bones)[..., j, None]
        pose.joints = joints
        return pose


class ForgetsInitial(_Walk):
    """The inputs are used as the angles. self.skeleton.theta(inputs) adds the initial values and ignores the inputs of
    fixed DoFs.
    """

    def theta(self, inputs: Array) -> Array:
        return np.asarray(inputs, dtype=np.float64)


class PivotAtEnd(_Walk):
    """The pivot of a rotation is its fixed point: the start of the joint, before its bone."""

    def pivot(self, p: Array, start: Array, end: Array) -> Array:
        return end


class OwnBonesOnly(_Walk):
    """The argument bones is ignored: if given, it holds the bone lengths of each pose."""

    def lengths(self, bones: Array | None) -> Array:
        return self.skeleton.bones


def _train(part: Transform, iterations: int, progress: Progress) -> Array:
    return hand.losses(part.kinematics, iterations, progress)


EXERCISE = Exercise(
    name="joint_transform",
    title="Joint transforms: from angles to positions",
    chapter=8,
    file="layers/hand/kinematics.py",
    to_do={
        "Kinematics.forward": "Return the Pose of each row of inputs. theta = self.skeleton.theta(inputs) has the "
        "DoF values, (N, D), with fixed DoFs and initial values applied. Loop over skeleton.order, parents first. A "
        "joint starts at its parent's pose.joints and pose.frames (a root, whose skeleton.parents "
        "is -1: at 0, with the identity). Apply skeleton.motions[j] in their order: motion.kind, "
        ".axis, .sign, .dof. Then write pose.joints[:, j] and pose.frames[:, j]; skeleton.bones "
        "and .bone_axes describe each joint's bone; bones, if given, replaces the lengths. "
        "Where motion.row >= 0, write pose.axis[:, row] and pose.pivot[:, row] before the motion "
        "is applied: its axis in world coordinates, with the sign, and the current point p of the "
        "joint. backward needs them.",
        "rotation": "Return R for every angle: the standard rotation matrices. About z, x rotates to y; about x, y to "
        "z; about y, z to x. For axis 2, z, R is [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]].",
    },
    names=("Kinematics.forward", "rotation"),
    part_of=lambda module: Transform(module.Kinematics, module.rotation),
    reference=REFERENCE,
    checks=(
        Check("values: a rotation about each axis", (_case("angles 0, 0.5, -1.2", _rotations, "rotation"),)),
        Check("values: a finger with three joints", (_case("two poses", _finger), _case("bones given", _other_bones))),
        Check("values: the axes and pivots of its motions", (_case("two poses", _motions),)),
        Check("values: Caffe's recorded hand poses", (
            Case("poses of the NYU hand", _caffe, _caffes, "Caffe has", AXES, 1e-12, "forward"),
        )),
    ),
    mistakes=tuple(Mistake(Transform(cls, cls.rotation), advice_of(cls)) for cls in (
        _Transposed,
        _YMirrored,
        _Degrees,
        OnTheLeft,
        ForgetsSign,
        ForgetsSignOfAxis,
        SlidesInWorld,
        TakesRows,
        BoneBeforeTurn,
        OtherOrder,
        StartsAtOrigin,
        ForgetsFrame,
        ChangesParent,
        ForgetsInitial,
        PivotAtEnd,
        OwnBonesOnly,
    )),
    train=_train,
)
