"""FastKinematics and FastHandModel: forward kinematics and its gradient for many poses at once,
and for a few.

Many poses: all arrays have the batch last, (..., N), so that it is the innermost loop of every
operation. Joints of one depth with equal steps (like fingers) are computed as one array, and fixed
rotations are multiplied in advance (joint_steps.py). The sums over the joints that a motion moves
are products with the 0/1 matrix ``Skeleton.moves``:

    dL/dtheta  =  a . ( sum_k X_k x f_k  -  P x sum_k f_k )

Positions are computed relative to the translated root, and the translation is added last. The
gradient of a distant hand therefore loses no digits, and float32 (``dtype``) is sufficient and
takes half the time.

A few poses: the time depends on the number of NumPy calls, not on the arithmetic (few_poses.py).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike

from fast.fast_layer import FastLayer
from fast.few_poses import FewPoses
from fast.joint_steps import Group, groups_of, steps_of
from layers.hand.hand_model import HandModel
from layers.hand.kinematics import Kinematics, Pose
from layers.hand.sized_hand_model import SizedHandModel
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, Blobs

# Up to this number of poses, FewPoses is faster (measured by experiments/parts.py: hand-1).
FEW = 16
NEXT_AXES = ((1, 2), (2, 0), (0, 1))  # the two axes that follow each one, cyclically


class FastPose(Pose):
    """Result of ``FastKinematics.forward`` for many poses, batch last.

    X       (K, 3, N) positions; ``joints`` is a view of them
    local   (K, 3, N) positions relative to the joint's translated root
    axis    (M, 3, N) world direction of each motion
    pivot   (M, 3, N) a point on each axis, relative to the translated root
    columns per group, the columns of world_from_joint, each (joints, 3, N)
    work    working memory of backward
    """

    def __init__(self, N: int, K: int, M: int, dtype: DTypeLike) -> None:
        self.X, self.local = np.empty((K, 3, N), dtype), np.empty((K, 3, N), dtype)
        self.axis, self.pivot = np.empty((M, 3, N), dtype), np.empty((M, 3, N), dtype)
        self.joints = self.X.transpose(2, 0, 1)
        self.columns: list[tuple[Array, Array, Array]] = []
        self.work: tuple[Array, ...] | None = None  # large arrays are slow to allocate


class FastKinematics(Kinematics):
    """Kinematics computed by groups of joints, with all poses in one array.

    There are M variable motions: the free ones, and fixed translations. Fixed rotations
    are precomputed.

    dof_of  (M,) the DoF of each motion
    free    (Q,) indices of the free motions, the rows of a Jacobian
    spare   a pose whose memory the next forward may reuse, because large arrays are
            slow to allocate
    """

    def __init__(self, skeleton: Skeleton, dtype: DTypeLike = np.float64) -> None:
        super().__init__(skeleton, dtype)
        steps = steps_of(skeleton)
        moving = [
            (j, step) for j, own in enumerate(steps) for step in own if step.kind != "constant"
        ]
        self.dof_of = np.array([step.dof for _, step in moving], dtype=int)
        self.free = np.flatnonzero(~skeleton.fixed[self.dof_of])
        self.spare: FastPose | None = None
        self._slides = np.flatnonzero([step.kind == "translate" for _, step in moving])
        self._joint_of = np.array([j for j, _ in moving], dtype=int)
        self._moves = skeleton.descendants[self._joint_of].astype(self.dtype)
        self._descendants = skeleton.descendants.astype(self.dtype)
        self.groups, self._places = groups_of(skeleton, steps, self.dtype)
        self._few = FewPoses(skeleton, steps)
        self._repeats = len(set(self.dof_of.tolist())) < len(self.dof_of)

    def joints(self, inputs: Array, bones: Array | None = None) -> Array:
        """Joint positions (N, K, 3)."""
        if len(inputs) <= FEW:
            values = self.skeleton.theta(inputs)[:, self.dof_of]
            return self._few.joints(values, bones).astype(self.dtype)
        return self.forward(inputs, bones).joints

    def forward(self, inputs: Array, bones: Array | None = None) -> FastPose:
        """Compute the pose for each row of ``inputs``, group by group, parents first."""
        sk = self.skeleton
        theta = np.array(inputs.T, dtype=self.dtype, order="C")
        theta[sk.fixed] = 0.0
        theta += sk.initial[:, None]
        values = theta[self.dof_of][:, None]  # (M, 1, N)
        cos, sin = np.cos(values), np.sin(values)
        lengths = np.asarray(sk.bones[:, None] if bones is None else bones.T, dtype=self.dtype)
        pose = self._new_pose(len(inputs))
        for group in self.groups:
            self._place_group(group, pose, lengths, values, cos, sin)
        pose.X += pose.local
        return pose

    def _new_pose(self, N: int) -> FastPose:
        pose, self.spare = self.spare, None
        if pose is None or pose.X.shape[-1] != N:
            pose = FastPose(N, len(self.skeleton.parents), len(self.dof_of), self.dtype)
        pose.columns = []
        return pose

    def _place_group(
        self, group: Group, pose: FastPose, lengths: Array, values: Array, cos: Array, sin: Array
    ) -> None:
        """Write the joints, axes, pivots and frames of a group, and the starts of its bodies to X.

        lengths           (K, 1 or N) signed bone lengths
        values, cos, sin  (M, 1, N) of all motions
        """
        shape = (len(group.joints), 3, pose.X.shape[-1])
        p = start = np.zeros((1, 3, 1), self.dtype)
        if group.parent < 0:
            axes = np.eye(3, dtype=self.dtype)
            frame = [np.broadcast_to(column[:, None], shape) for column in axes]
        else:
            frame = [column[group.slots] for column in pose.columns[group.parent]]
            p = pose.local[self.groups[group.parent].joints][group.slots]
        for kind, k, rows, sign, matrices in group.operations:
            if kind == "constant":
                frame = _turn_constant(frame, matrices)
                continue
            pose.axis[rows] = frame[k] * sign
            pose.pivot[rows] = p
            if kind == "rotate":  # right-multiplication by R_k combines the two other columns
                i, j = NEXT_AXES[k]
                c, s = cos[rows], sin[rows] * sign
                frame[i], frame[j] = c * frame[i] + s * frame[j], c * frame[j] - s * frame[i]
            elif group.parent < 0:
                start = start + pose.axis[rows] * values[rows]
            else:
                p = p + pose.axis[rows] * values[rows]
        for body, body_start in zip(group.bodies, np.broadcast_to(start, shape)):
            pose.X[body] = body_start
        pose.local[group.joints] = p + frame[group.bone_axis] * lengths[group.joints][:, None]
        pose.columns.append((frame[0], frame[1], frame[2]))

    def forward_pose(self, inputs: Array, bones: Array | None = None) -> Pose:
        """Like ``forward``, but without the data that ``backward`` needs; fast for a few poses."""
        if len(inputs) > FEW:
            return self.forward(inputs, bones)
        values = self.skeleton.theta(inputs)[:, self.dof_of]
        return self._few.pose(values, self.free, bones, self.dtype)

    def backward(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, D) with respect to the inputs; two products give the forces and torques
        of all motions.
        """
        assert isinstance(pose, FastPose)
        K, _, N = pose.X.shape
        f = np.ascontiguousarray(dX.transpose(1, 2, 0), dtype=self.dtype)
        if pose.work is None:
            pose.work = (*(np.empty_like(pose.pivot) for _ in range(3)), np.empty_like(pose.X))
        force, torque, offset, turning = pose.work
        np.matmul(self._moves, f.reshape(K, 3 * N), out=force.reshape(len(force), 3 * N))
        moments = _cross(pose.local, f, turning).reshape(K, 3 * N)
        np.matmul(self._moves, moments, out=torque.reshape(len(torque), 3 * N))
        torque -= _cross(pose.pivot, force, offset)
        torque[self._slides] = force[self._slides]
        torque *= pose.axis
        gradient = np.zeros((len(self.skeleton.initial), N), self.dtype)
        if self._repeats:  # one DoF drives several joints
            np.add.at(gradient, self.dof_of, torque.sum(axis=1))
        else:
            gradient[self.dof_of] = torque.sum(axis=1)
        gradient[self.skeleton.fixed] = 0
        return gradient.T

    def backward_bones(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, K) with respect to the signed bone lengths; one product gives all forces."""
        f = np.ascontiguousarray(dX.transpose(1, 2, 0), dtype=self.dtype)
        force = (self._descendants @ f.reshape(len(f), -1)).reshape(f.shape)
        along_bones = self.bone_directions(pose).transpose(1, 2, 0) * force
        return np.asarray(along_bones.sum(axis=1).T)

    def jacobian(self, pose: Pose, joints: Sequence[int] | None = None) -> Array:
        """Jacobian (N, Q, 3 k), by components of the cross product; for a few poses by
        skew-symmetric matrices.
        """
        sk = self.skeleton
        chosen = list(range(len(sk.parents))) if joints is None else list(joints)
        if not isinstance(pose, FastPose):
            arm = pose.joints[:, None, chosen] - pose.pivot[:, :, None]
            J = arm @ np.cross(pose.axis[:, :, None], np.eye(3))
            J[:, ~sk.turns] = pose.axis[:, ~sk.turns, None]
            J *= sk.moves[:, chosen, None]
            return J.reshape(*J.shape[:2], 3 * len(chosen))
        Q, N = len(self.free), pose.X.shape[-1]
        X = pose.local[chosen]
        a = pose.axis[self.free][:, None]
        P = pose.pivot[self.free][:, None]
        arm = np.where(sk.turns[:, None, None, None], X - P, 0.0)
        J = np.empty((Q, len(chosen), 3, N))
        for i, (j, k) in enumerate(NEXT_AXES):
            J[:, :, i] = a[:, :, j] * arm[:, :, k] - a[:, :, k] * arm[:, :, j]
        J[~sk.turns] = a[~sk.turns]
        J *= sk.moves[:, chosen, None, None]
        return J.reshape(Q, 3 * len(chosen), N).transpose(2, 0, 1)

    def bone_directions(self, pose: Pose) -> Array:
        """Direction of each bone (N, K, 3), from the frames of the groups."""
        assert isinstance(pose, FastPose)
        directions = np.zeros_like(pose.X)
        for group, frame in zip(self.groups, pose.columns):
            directions[group.joints] = frame[group.bone_axis]
        directions[self.skeleton.bone_axes < 0] = 0
        return directions.transpose(2, 0, 1)

    def axes(self, pose: Pose) -> tuple[Array, Array]:
        """Axes of the free motions and points on them, both (N, Q, 3); the translations of the
        roots are added.
        """
        if not isinstance(pose, FastPose):
            return super().axes(pose)
        start = (pose.X - pose.local)[self._joint_of[self.free]]
        pivot = pose.pivot[self.free] + start
        return pose.axis[self.free].transpose(2, 0, 1), pivot.transpose(2, 0, 1)

    def rotation_of(self, pose: Pose, joint: int) -> Array:
        """The rotation world_from_joint of one joint, (N, 3, 3), from the frames of its group."""
        if not isinstance(pose, FastPose):
            return super().rotation_of(pose, joint)
        group, slot = self._places[joint]
        columns = [np.broadcast_to(c[slot], pose.X.shape[1:]) for c in pose.columns[group]]
        return np.stack(columns, axis=1).transpose(2, 0, 1)


def _turn_constant(frame: list[Array], matrices: Array) -> list[Array]:
    """Right-multiply the frames, three columns of (1 or n, 3, N), by constant
    ``matrices`` (n, 3, 3).
    """
    if len(frame[0]) == 1:  # one parent: one product for all columns of all joints
        N = frame[0].shape[-1]
        rows = matrices.transpose(0, 2, 1).reshape(-1, 3)
        columns = rows @ np.concatenate(frame).reshape(3, 3 * N)
        return list(columns.reshape(len(matrices), 3, 3, N).transpose(1, 0, 2, 3))
    return [_combine(matrices[:, :, c], frame) for c in range(3)]


def _combine(weights: Array, columns: list[Array]) -> Array:
    """Sum weights[:, k] columns[k] over k = 0, 1, 2, from (n, 3) and three
    (n, 3, N) to (n, 3, N).
    """
    a, b, c = (weights[:, m, None, None] * columns[m] for m in range(3))
    return a + b + c


def _cross(a: Array, b: Array, out: Array) -> Array:
    """Cross product along axis 1 of (n, 3, N) arrays."""
    for i, (j, k) in enumerate(NEXT_AXES):
        np.multiply(a[:, j], b[:, k], out=out[:, i])
        out[:, i] -= a[:, k] * b[:, j]
    return out


class FastHandModel(FastLayer, HandModel):
    """HandModel with FastKinematics."""

    kinematics_type = FastKinematics
    kinematics: FastKinematics

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute the joints; the pose is stored only if backward needs it."""
        inputs_and_bones = self._body(bottom)
        y = top[0].data.reshape(-1, len(self.skeleton.joint_names), 3)
        if self.needs_backward:
            self.pose = self.kinematics.forward(*inputs_and_bones)
            y[...] = self.pose.joints
            self.kinematics.spare = self.pose  # not used after backward
        else:
            y[...] = self.kinematics.joints(*inputs_and_bones)


class FastSizedHandModel(FastHandModel, SizedHandModel):
    """SizedHandModel with FastKinematics."""
