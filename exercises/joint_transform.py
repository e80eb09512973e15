"""The exercise joint_transform: where the joints of a hand are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from exercises import hand, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Tell, Values, advice_of
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
    """The part: the class, and the function that its module has for one rotation."""

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


OURS = Transform(Kinematics, source.rotation)


def _case(title: str, run: Callable[[Transform], Values], method: str = "forward") -> Case:
    return Case(title, run, lambda part: run(OURS), "it should be", AXES, 1e-12, method)


def _caffes(part: Part) -> Values:
    top = recorded.everything()["hand_model/top_f64"]
    return {"joints": top.reshape(len(top), -1, 3)}


# ---------------------------------------------------------------------------------------------- mistakes


class _Walk(Kinematics):
    """A forward in pieces, one of which is wrong."""

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

    def told_axis(self, F: Array, motion: Motion) -> Array:
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
            begin, before, met = p, F, []
            for motion in self.motions(j):
                if motion.row >= 0:
                    pose.axis[:, motion.row] = self.told_axis(F, motion)
                    met.append((motion.row, p))
                if motion.kind == "translate":
                    p = p + self.axis(F, motion) * theta[:, motion.dof, None]
                else:
                    F = self.turned(F, motion, theta[:, motion.dof])
            along = self.bone_frame(F, before)[:, :, sk.bone_axes[j]]
            pose.joints[:, j], pose.frames[:, j] = p + along * lengths[:, j, None], F
            for row, there in met:
                pose.pivot[:, row] = self.pivot(there, begin, pose.joints[:, j])
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
    """The rotation turns the other way: the minus belongs to the sine in the upper row, of (x, y) for z, (y, z) for x,
    (z, x) for y.
    """

    rotation = staticmethod(_transposed)


class _YMirrored(_Walk):
    """The rotation about y turns the other way; the other two are right. After y comes z, then x: so the minus stands
    in the row of z, below the diagonal.
    """

    rotation = staticmethod(_y_mirrored)


class _Degrees(_Walk):
    """The angles are in radians already."""

    rotation = staticmethod(_degrees)


class OnTheLeft(_Walk):
    """The matrices are multiplied in the wrong order. A joint turns about its own axes, which the turns before have
    moved: F <- F R, and not R F.
    """

    def turned(self, F: Array, motion: Motion, angle: Array) -> Array:
        return np.asarray(self.rotation(motion.axis, motion.sign * angle) @ F)


class ForgetsSign(_Walk):
    """motion.sign is left out: NEG_Y is a turn about -y, which is one about y by -theta."""

    def turned(self, F: Array, motion: Motion, angle: Array) -> Array:
        return np.asarray(F @ self.rotation(motion.axis, angle))


class ForgetsSignOfAxis(_Walk):
    """pose.axis has no sign: of a turn about -y the axis is -F e_y."""

    def told_axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(F[:, :, motion.axis])


class SlidesInWorld(_Walk):
    """The translation goes along the axes of the world. It goes along the joint's own axis: F e_axis, a column of F."""

    def axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * np.broadcast_to(np.eye(3)[motion.axis], (len(F), 3)))

    def told_axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * F[:, :, motion.axis])


class TakesRows(_Walk):
    """F[:, axis] is a row of F. F e_axis is a column: F[:, :, axis]."""

    def axis(self, F: Array, motion: Motion) -> Array:
        return np.asarray(motion.sign * F[:, motion.axis])


class BoneBeforeTurn(_Walk):
    """The bone lies along the parent's axis. It is moved along after the turns: use the joint's own F."""

    def bone_frame(self, F: Array, before: Array) -> Array:
        return before


class OtherOrder(_Walk):
    """The motions are applied in the wrong order; it is that of skeleton.motions[j]."""

    def motions(self, j: int) -> list[Motion]:
        return list(self.skeleton.motions[j])[::-1]


class StartsAtOrigin(_Walk):
    """Every joint starts at the origin. It starts where its parent is: pose.joints[:, parent]."""

    def start(self, pose: Pose, j: int, count: int) -> tuple[Array, Array]:
        _, F = super().start(pose, j, count)
        return np.zeros((count, 3)), F


class ForgetsFrame(_Walk):
    """Every joint begins unturned. It begins with its parent's frame: pose.frames[:, parent]."""

    def start(self, pose: Pose, j: int, count: int) -> tuple[Array, Array]:
        p, _ = super().start(pose, j, count)
        return p, np.broadcast_to(np.eye(3), (count, 3, 3))


class ChangesParent(_Walk):
    """p += ... changes the parent's joint, too: p is a view of pose.joints[:, parent]. Write p = p + ..., which makes a
    new array.
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
    """The inputs are taken for the angles. self.skeleton.theta(inputs) adds the initial values, and keeps fixed DoFs at
    theirs.
    """

    def theta(self, inputs: Array) -> Array:
        return np.asarray(inputs, dtype=np.float64)


class PivotAtEnd(_Walk):
    """The pivot of a turn is the point that stays where it is: where the joint begins, before its bone."""

    def pivot(self, p: Array, start: Array, end: Array) -> Array:
        return end


class OwnBonesOnly(_Walk):
    """The argument bones is left out: if it is given, each pose has bone lengths of its own."""

    def lengths(self, bones: Array | None) -> Array:
        return self.skeleton.bones


def _train(part: Transform, iterations: int, tell: Tell) -> Array:
    return hand.losses(part.kinematics, iterations, tell)


EXERCISE = Exercise(
    name="joint_transform",
    title="A joint's transform: from angles to positions",
    chapter=8,
    file="layers/hand/kinematics.py",
    to_do={
        "Kinematics.forward": "Return the Pose of each row of inputs. theta = self.skeleton.theta(inputs) has the "
        "DoFs' values, (N, D), with what is fixed or added. Walk over skeleton.order, parents first. A "
        "joint starts at its parent's pose.joints and pose.frames (a root, whose skeleton.parents "
        "is -1: at 0, with the identity). Apply skeleton.motions[j] in their order: motion.kind, "
        ".axis, .sign, .dof. Then write pose.joints[:, j] and pose.frames[:, j]; skeleton.bones "
        "and .bone_axes have each joint's bone, and bones, if given, other lengths.\n"
        "Where motion.row >= 0, write pose.axis[:, row] and pose.pivot[:, row] before the motion "
        "is applied: its axis in the world, with the sign, and the point p where the joint is "
        "then. backward needs them.",
        "rotation": "Return R for every angle: the textbook's matrices. About z, x is turned to y; about x, y to "
        "z; about y, z to x. For axis 2, z, R is [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]].",
    },
    names=("Kinematics.forward", "rotation"),
    part_of=lambda module: Transform(module.Kinematics, module.rotation),
    ours=OURS,
    checks=(
        Check("values: a rotation about each axis", (_case("angles 0, 0.5, -1.2", _rotations, "rotation"),)),
        Check("values: a finger of three joints", (_case("two poses", _finger), _case("bones given", _other_bones))),
        Check("values: the axes and the pivots of its motions", (_case("two poses", _motions),)),
        Check("values: the hands that Caffe posed", (
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
)  # fmt: skip
