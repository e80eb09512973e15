"""Exercise: the gradient of joint positions from torques."""

from __future__ import annotations

import numpy as np

from exercises import hand, recorded
from exercises.exercise import Case, Check, Exercise, Part, Values, known_in
from layers.hand.kinematics import Kinematics, Pose
from layers.hand.skeleton import Motion, Skeleton
from netlib.blob import Array

AXES = {"dtheta": ("pose", "dof"), "dX (after backward)": ("pose", "joint", "xyz")}
STEP = 1e-6


def _run(part: type[Kinematics], skeleton: Skeleton, inputs: Array, dX: Array) -> Values:
    kinematics = part(skeleton)
    given = dX.copy()
    return {"dtheta": kinematics.backward(kinematics.forward(inputs), given), "dX (after backward)": given}


def _differences(skeleton: Skeleton, inputs: Array, dX: Array) -> Values:
    """Compute dtheta by central differences of sum dX . X."""
    kinematics = Kinematics(skeleton)

    def value(moved: Array) -> Array:
        return np.asarray((kinematics.forward(moved).joints * dX).sum(axis=(1, 2)))

    found = np.zeros(inputs.shape)
    for d, step in enumerate(np.eye(inputs.shape[1]) * STEP):
        found[:, d] = (value(inputs + step) - value(inputs - step)) / (2 * STEP)
    return {"dtheta": found, "dX (after backward)": dX}


def _by_differences(title: str, skeleton: Skeleton, dX: Array) -> Case:
    inputs = hand.poses(skeleton, len(dX))
    return Case(
        title,
        lambda part: _run(part, skeleton, inputs, dX),
        lambda: _differences(skeleton, inputs, dX),
        "finite differences give",
        AXES,
        1e-7,
        "backward",
    )


def _forces(skeleton: Skeleton, only: int | None = None) -> Array:
    dX = np.random.default_rng(1).normal(size=(2, len(skeleton.parents), 3))
    if only is not None:
        dX[:, [j for j in range(dX.shape[1]) if j != only]] = 0
    return dX


def _caffe(part: Part) -> Values:
    arrays = recorded.everything()
    dX = arrays["hand_model/top_diff"].astype(np.float64)
    found = _run(part, hand.nyu_hand(), arrays["hand_model/bottom"], dX.reshape(len(dX), -1, 3))
    return {"dtheta": found["dtheta"]}


def _caffes() -> Values:
    return {"dtheta": recorded.everything()["hand_model/bottom_diff_f64"]}


# ---------------------------------------------------------------------------------------------- mistakes


class _Climb(Kinematics):
    """backward split into methods; each subclass breaks one."""

    def order(self) -> list[int]:
        return list(reversed(self.skeleton.order))

    def copied(self, dX: Array) -> Array:
        return np.array(dX, dtype=np.float64)

    def is_free(self, motion: Motion) -> bool:
        return motion.row >= 0

    def about_P(self, X: Array, P: Array, force: Array, torque: Array) -> Array:
        return np.asarray(torque + np.cross(X - P, force))

    def push(self, motion: Motion, force: Array, about_P: Array) -> Array:
        return force if motion.kind == "translate" else about_P

    def enter(self, dtheta: Array, dof: int, value: Array) -> None:
        dtheta[:, dof] += value

    def up(self, force: Array, torque: Array, X: Array, j: int, parent: int) -> None:
        force[:, parent] += force[:, j]
        torque[:, parent] += torque[:, j] + np.cross(X[:, j] - X[:, parent], force[:, j])

    def backward(self, pose: Pose, dX: Array) -> Array:
        sk, X = self.skeleton, pose.joints
        force, torque = self.copied(dX), np.zeros(dX.shape)
        dtheta = np.zeros((len(dX), len(sk.initial)))
        for j in self.order():
            for motion in sk.motions[j]:
                if self.is_free(motion):
                    a, P = pose.axis[:, motion.row], pose.pivot[:, motion.row]
                    about_P = self.about_P(X[:, j], P, force[:, j], torque[:, j])
                    self.enter(dtheta, motion.dof, (a * self.push(motion, force[:, j], about_P)).sum(axis=1))
            if sk.parents[j] >= 0:
                self.up(force, torque, X, j, sk.parents[j])
        return dtheta.astype(self.dtype)


class CrossReversed(_Climb):
    """The cross product has the wrong order: a torque is arm x force, (X - P) x f."""

    def about_P(self, X: Array, P: Array, force: Array, torque: Array) -> Array:
        return np.asarray(torque + np.cross(force, X - P))


class LeverReversed(_Climb):
    """The cross product for the parent has the wrong order: (X_c - X_j) x force_c."""

    def up(self, force: Array, torque: Array, X: Array, j: int, parent: int) -> None:
        force[:, parent] += force[:, j]
        torque[:, parent] += torque[:, j] + np.cross(force[:, j], X[:, j] - X[:, parent])


class AllReversed(_Climb):
    """Every torque has the wrong sign: the cross product has the wrong order. A torque is arm x force."""

    def about_P(self, X: Array, P: Array, force: Array, torque: Array) -> Array:
        return np.asarray(-super().about_P(X, P, force, torque))


class LastJointOnly(_Climb):
    """Each joint that a motion carries overwrites the value of the previous one. Sum their torques, also those of
    several motions of one DoF: dtheta[:, dof] += ...
    """

    def backward(self, pose: Pose, dX: Array) -> Array:
        sk, X = self.skeleton, pose.joints
        dtheta = np.zeros((len(dX), len(sk.initial)))
        for j, motions in enumerate(sk.motions):
            for motion in motions:
                if motion.row >= 0:
                    a, P = pose.axis[:, motion.row], pose.pivot[:, motion.row]
                    k = int(np.flatnonzero(sk.descendants[j])[-1])
                    push = dX[:, k] if motion.kind == "translate" else np.cross(X[:, k] - P, dX[:, k])
                    dtheta[:, motion.dof] = (a * push).sum(axis=1)
        return dtheta.astype(self.dtype)


class AboutJoint(_Climb):
    """This is the torque about the joint itself. The motion rotates about its pivot P: add (X_j - P) x force_j."""

    def about_P(self, X: Array, P: Array, force: Array, torque: Array) -> Array:
        return torque


class AboutOrigin(_Climb):
    """This is the torque about the origin. The motion rotates about its pivot P: the arm is X_j - P."""

    def about_P(self, X: Array, P: Array, force: Array, torque: Array) -> Array:
        return np.asarray(torque + np.cross(X, force))


class KeepsForce(_Climb):
    """The force on a child must be added to its parent's: moving the parent moves all its descendants."""

    def up(self, force: Array, torque: Array, X: Array, j: int, parent: int) -> None:
        torque[:, parent] += torque[:, j] + np.cross(X[:, j] - X[:, parent], force[:, j])


class NoLever(_Climb):
    """The child's torque is about the child, not about its parent: add (X_c - X_j) x force_c."""

    def up(self, force: Array, torque: Array, X: Array, j: int, parent: int) -> None:
        force[:, parent] += force[:, j]
        torque[:, parent] += torque[:, j]


class KeepsTorque(_Climb):
    """The child's own torque is not added to its parent's: torque_c + (X_c - X_j) x force_c."""

    def up(self, force: Array, torque: Array, X: Array, j: int, parent: int) -> None:
        force[:, parent] += force[:, j]
        torque[:, parent] += np.cross(X[:, j] - X[:, parent], force[:, j])


class Overwrites(_Climb):
    """A DoF may drive several motions; its gradient is the sum over them: dtheta[:, dof] += ..."""

    def enter(self, dtheta: Array, dof: int, value: Array) -> None:
        dtheta[:, dof] = value


class TurnsAll(_Climb):
    """A translation has no torque: its gradient is a . force_j."""

    def push(self, motion: Motion, force: Array, about_P: Array) -> Array:
        return about_P


class ParentsFirst(_Climb):
    """The joints are visited from the root to the tips. Visit children before parents: reversed(skeleton.order)."""

    def order(self) -> list[int]:
        return list(self.skeleton.order)


class FileOrder(_Climb):
    """The joints are visited in file order, or its reverse. Neither visits children before parents in every skeleton;
    use reversed(skeleton.order).
    """

    def order(self) -> list[int]:
        return list(range(len(self.skeleton.parents)))


class ReversedFileOrder(FileOrder):
    """The joints are visited in reverse file order. In the hand's file some children precede their parents and some
    follow them: reversed(skeleton.order) visits all children first.
    """

    def order(self) -> list[int]:
        return list(reversed(super().order()))


class CountsLeverTwice(_Climb):
    """The sum over the children is added once for every motion of the joint. Add a joint's force and torque to its
    parent's after the loop over its motions, and do not change torque[:, j] within the loop.
    """

    def backward(self, pose: Pose, dX: Array) -> Array:
        sk, X = self.skeleton, pose.joints
        force, torque = self.copied(dX), np.zeros(dX.shape)
        dtheta = np.zeros((len(dX), len(sk.initial)))
        for j in self.order():
            for motion in sk.motions[j]:
                if motion.row >= 0:
                    a, P = pose.axis[:, motion.row], pose.pivot[:, motion.row]
                    torque[:, j] += np.cross(X[:, j] - P, force[:, j])
                    push = force[:, j] if motion.kind == "translate" else torque[:, j]
                    dtheta[:, motion.dof] += (a * push).sum(axis=1)
            if sk.parents[j] >= 0:
                self.up(force, torque, X, j, sk.parents[j])
        return dtheta.astype(self.dtype)


class AboutParent(_Climb):
    """This is the torque about the parent. The pivot P lies after the translations of the same joint: pose.pivot[:,
    row], not X of the parent.
    """

    def backward(self, pose: Pose, dX: Array) -> Array:
        sk = self.skeleton
        moved = Pose(len(dX), len(sk.parents), len(sk.driven))
        moved.joints, moved.axis, moved.pivot = pose.joints, pose.axis, pose.pivot.copy()
        for j, motions in enumerate(sk.motions):
            for motion in motions:
                if motion.row >= 0:
                    parent = sk.parents[j]
                    moved.pivot[:, motion.row] = pose.joints[:, parent] if parent >= 0 else 0
        return super().backward(moved, dX)


class FinishedAxis(_Climb):
    """The axis is taken from the joint's final frame, after all its rotations. A motion rotates about the axis at the
    time it is applied: pose.axis[:, row].
    """

    def backward(self, pose: Pose, dX: Array) -> Array:
        sk = self.skeleton
        moved = Pose(len(dX), len(sk.parents), len(sk.driven))
        moved.joints, moved.axis, moved.pivot = pose.joints, pose.axis.copy(), pose.pivot
        for j, motions in enumerate(sk.motions):
            for motion in motions:
                if motion.row >= 0:
                    moved.axis[:, motion.row] = motion.sign * pose.frames[:, j, :, motion.axis]
        return super().backward(moved, dX)


class ChangesGiven(_Climb):
    """dX is modified: it belongs to the next layer. Sum the forces in a copy."""

    def copied(self, dX: Array) -> Array:
        return dX


class MovesFixed(_Climb):
    """Fixed DoFs have no gradient, as their inputs are ignored. Their motions have row -1, which would index the last
    row.
    """

    def is_free(self, motion: Motion) -> bool:
        return True


FINGER = hand.finger()

EXERCISE = Exercise(
    name="torque_gradient",
    title="The torque gradient: from forces on joints to angles",
    chapter=9,
    file="layers/hand/kinematics.py",
    to_do={
        "Kinematics.backward": "Return dtheta (N, D) in self.dtype. Begin with force = a float64 copy of dX and torque "
        "= 0, and loop over reversed(skeleton.order), so that a joint contains the sums of its children "
        "before it is visited. For each of its motions with motion.row >= 0 (the others are fixed) "
        "add to dtheta[:, motion.dof]; a is pose.axis[:, row], P is pose.pivot[:, row], and a DoF "
        "may drive several motions. Then add the joint's force and torque to its parent's. "
        "np.cross(u, v) works along the last axis.",
    },
    names=("Kinematics.forward", "Kinematics.backward"),
    part_of=lambda module: module.Kinematics,
    reference=Kinematics,
    checks=(
        Check("gradient: a finger, against finite differences", (
            _by_differences("a force on the base alone", FINGER, _forces(FINGER, 0)),
            _by_differences("a force on the middle alone", FINGER, _forces(FINGER, 1)),
            _by_differences("a force on the tip alone", FINGER, _forces(FINGER, 2)),
            _by_differences("forces on all joints", FINGER, _forces(FINGER)),
        )),
        Check("gradient: Caffe's recorded hand poses", (
            Case("poses of the NYU hand", _caffe, _caffes, "Caffe has", AXES, 1e-11, "backward"),
        )),
    ),
    mistakes=known_in(globals(), Kinematics),
    train=hand.losses,
)
