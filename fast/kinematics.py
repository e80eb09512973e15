"""FastKinematics: forward kinematics and its gradient for many poses at once, and for a few.

Many poses. Everything is batch last, (..., N): the innermost loop of every operation is then the batch. Joints of the
same depth and the same sequence of operations (four fingers) go together as one array. Turns about fixed angles are
multiplied out beforehand. The sums over the joints that a motion moves are products with the 0/1 matrix
``Skeleton.moves``:

    dL/dtheta  =  a . ( sum_k X_k x f_k  -  P x sum_k f_k )

Positions are kept relative to where the root has moved to, and moved there last: the gradient of a hand far away loses
no digits, so float32 is enough (``dtype``), and takes half the time.

A few poses. There the number of NumPy calls counts and not the arithmetic (``FewPoses``).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from layers.hand.kinematics import Kinematics, Pose, rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

FEW = 16  # poses up to which fewer calls are faster than fewer operations (benchmarks/twins.py: one image)


class Part(NamedTuple):
    """One motion of one joint, or several fixed turns multiplied out."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int = -1  # local axis of a motion
    sign: float = 1.0  # -1: about or along the negative axis
    number: int = -1  # of the motion among the M that are not constants
    dof: int = -1
    matrix: Array | None = None  # of a constant: fixed rotations, multiplied out


class Operation(NamedTuple):
    """The same part of n joints."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int
    rows: slice | list[int]  # of the motions
    sign: Array  # (n, 1, 1)
    matrices: Array  # (n, 3, 3) of the constants


@dataclass
class Group:
    """Joints of one depth whose parts have the same kinds and axes: they are computed as one array."""

    joints: list[int]
    parent: int  # the group of their parents, -1 for roots
    slots: slice | list[int]  # where the parents stand in that group
    operations: list[Operation]
    bone_axis: int
    bodies: list[slice | list[int]]  # of roots: the joints of each one's body, itself too


class FastPose(Pose):
    """A pose of many hands, batch last.

    X       (K, 3, N) positions; ``joints`` is a view of them
    local   (K, 3, N) positions from where the joint's root has moved to
    axis    (M, 3, N) world direction of each motion
    pivot   (M, 3, N) a point on each axis, from there too
    columns per group the columns of world_from_joint, each (joints, 3, N)
    work    what backward needs for a while
    """

    def __init__(self, N: int, K: int, M: int, dtype: DTypeLike) -> None:
        self.X, self.local = np.empty((K, 3, N), dtype), np.empty((K, 3, N), dtype)
        self.axis, self.pivot = np.empty((M, 3, N), dtype), np.empty((M, 3, N), dtype)
        self.joints = self.X.transpose(2, 0, 1)
        self.columns: list[tuple[Array, Array, Array]] = []
        self.work: tuple[Array, ...] | None = None  # large arrays are slow to get anew


class FastKinematics(Kinematics):
    """Kinematics by groups of joints, all poses in one array.

    M motions are computed one by one: the free ones, and fixed translations.

    dof_of  (M,) the DoF of each
    free    (Q,) which of them are free: the rows of a Jacobian
    spare   a pose whose memory the next forward may take; large arrays are slow to get anew
    """

    def __init__(self, skeleton: Skeleton, dtype: DTypeLike = np.float64) -> None:
        super().__init__(skeleton, dtype)
        steps = _steps(skeleton)
        moving = [(j, step) for j, own in enumerate(steps) for step in own if step.kind != "constant"]
        self.dof_of = np.array([step.dof for _, step in moving], dtype=int)
        self.free = np.flatnonzero(~skeleton.fixed[self.dof_of])
        self.spare: FastPose | None = None
        self._slides = np.flatnonzero([step.kind == "translate" for _, step in moving])
        self._joint_of = np.array([j for j, _ in moving], dtype=int)
        carried = skeleton.carries[[j for j, _ in moving]].reshape(len(moving), len(skeleton.parents))
        self._moves = carried.astype(self.dtype)
        self.groups, self._places = _groups(skeleton, steps, self.dtype)
        self._few = FewPoses(skeleton, steps)
        self._repeats = len(set(self.dof_of.tolist())) < len(self.dof_of)

    def joints(self, inputs: Array, bones: Array | None = None) -> Array:
        """Joint positions (N, K, 3)."""
        if bones is None and len(inputs) <= FEW:
            return self._few.joints(self.skeleton.theta(inputs)[:, self.dof_of]).astype(self.dtype)
        return self.forward(inputs, bones).joints

    def forward(self, inputs: Array, bones: Array | None = None) -> FastPose:
        """Group by group, parents first."""
        N, sk = len(inputs), self.skeleton
        theta = np.array(inputs.T, dtype=self.dtype, order="C")
        theta[sk.fixed] = 0.0
        theta += sk.initial[:, None]
        value = theta[self.dof_of]  # (M, N)
        cos, sin = np.cos(value), np.sin(value)
        pose = self.spare
        if pose is None or pose.X.shape[-1] != N:
            pose = FastPose(N, len(sk.parents), len(self.dof_of), self.dtype)
        self.spare, pose.columns = None, []
        X, local, axis, pivot = pose.X, pose.local, pose.axis, pose.pivot
        lengths = np.asarray(sk.bones[:, None] if bones is None else bones.T, dtype=self.dtype)
        origin = [np.broadcast_to(e[None, :, None], (1, 3, N)) for e in np.eye(3, dtype=self.dtype)]
        for group in self.groups:
            p = start = np.zeros((1, 3, 1), self.dtype)
            if group.parent < 0:
                frame = list(origin)
            else:
                frame = [column[group.slots] for column in pose.columns[group.parent]]
                p = local[self.groups[group.parent].joints][group.slots]
            for kind, k, rows, sign, matrices in group.operations:
                if kind == "constant":
                    frame = _turn_constant(frame, matrices)
                    continue
                axis[rows], pivot[rows] = frame[k] * sign, p
                if kind == "translate" and group.parent < 0:
                    start = start + axis[rows] * value[rows][:, None]
                elif kind == "translate":
                    p = p + axis[rows] * value[rows][:, None]
                else:  # right-multiplying by R_k(angle) mixes the two other columns
                    i, j = (k + 1) % 3, (k + 2) % 3
                    c, s = cos[rows][:, None], sin[rows][:, None] * sign
                    frame[i], frame[j] = c * frame[i] + s * frame[j], c * frame[j] - s * frame[i]
            for body, from_where in zip(group.bodies, np.broadcast_to(start, (len(group.joints), 3, N))):
                X[body] = from_where
            local[group.joints] = p + frame[group.bone_axis] * lengths[group.joints][:, None]
            pose.columns.append((frame[0], frame[1], frame[2]))
        X += local
        return pose

    def glance(self, inputs: Array, bones: Array | None = None) -> Pose:
        """Of a few poses, with few calls."""
        if len(inputs) > FEW:
            return self.forward(inputs, bones)
        return self._few.pose(self.skeleton.theta(inputs)[:, self.dof_of], self.free, bones, self.dtype)

    def backward(self, pose: Pose, dX: Array) -> Array:
        """Force and torque of all motions in two products."""
        assert isinstance(pose, FastPose)
        K, _, N = pose.X.shape
        f = np.ascontiguousarray(dX.transpose(1, 2, 0), dtype=self.dtype)
        if pose.work is None:
            pose.work = (*(np.empty_like(pose.pivot) for _ in range(3)), np.empty_like(pose.X))
        force, torque, offset, turning = pose.work
        np.matmul(self._moves, f.reshape(K, 3 * N), out=force.reshape(len(force), 3 * N))
        np.matmul(self._moves, _cross(pose.local, f, turning).reshape(K, 3 * N), out=torque.reshape(len(torque), 3 * N))
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

    def jacobian(self, pose: Pose, joints: Sequence[int] | None = None) -> Array:
        """Component by component of the cross product."""
        assert isinstance(pose, FastPose)
        sk = self.skeleton
        chosen = list(range(len(sk.parents))) if joints is None else list(joints)
        Q, N = len(self.free), pose.X.shape[-1]
        X, a, P = pose.local[chosen], pose.axis[self.free][:, None], pose.pivot[self.free][:, None]
        arm = np.where(sk.turns[:, None, None, None], X - P, 0.0)
        J = np.empty((Q, len(chosen), 3, N))
        for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
            J[:, :, i] = a[:, :, j] * arm[:, :, k] - a[:, :, k] * arm[:, :, j]
        J[~sk.turns] = a[~sk.turns]
        J *= sk.moves[:, chosen, None, None]
        return J.reshape(Q, -1, N).transpose(2, 0, 1)

    def bone_directions(self, pose: Pose) -> Array:
        """From the frames of the groups."""
        assert isinstance(pose, FastPose)
        directions = np.zeros_like(pose.X)
        for group, frame in zip(self.groups, pose.columns):
            directions[group.joints] = frame[group.bone_axis]
        directions[self.skeleton.bone_axes < 0] = 0
        return directions.transpose(2, 0, 1)

    def axes(self, pose: Pose) -> tuple[Array, Array]:
        """Pivots are moved to where the roots are."""
        if not isinstance(pose, FastPose):
            return super().axes(pose)
        start = (pose.X - pose.local)[self._joint_of[self.free]]
        return pose.axis[self.free].transpose(2, 0, 1), (pose.pivot[self.free] + start).transpose(2, 0, 1)

    def rotation_of(self, pose: Pose, joint: int) -> Array:
        """From the frame of its group."""
        if not isinstance(pose, FastPose):
            return super().rotation_of(pose, joint)
        group, slot = self._places[joint]
        columns = [np.broadcast_to(c[slot], pose.X.shape[1:]) for c in pose.columns[group]]
        return np.stack(columns, axis=1).transpose(2, 0, 1)


class FewPoses:
    """Forward kinematics for a few poses, where the number of NumPy calls counts and not the arithmetic.

    A turn about a fixed axis is R(t) = P + cos t C + sin t S with constant matrices (Rodrigues), so all turns of a pose
    come from three operations. All joints multiply their own turns and their bone to a 4 x 4 transform at once; then
    one product per depth attaches the joints of that depth to their parents. Joints are in order of depth in here.
    """

    def __init__(self, skeleton: Skeleton, steps: Sequence[Sequence[Part]]) -> None:
        order = np.array(skeleton.order)
        self.place = np.argsort(order)  # of each joint
        motions = [step for own in steps for step in own if step.kind != "constant"]
        self.P, self.C, self.S = _rodrigues(motions)
        self.constants = np.array(
            [*(step.matrix for own in steps for step in own if step.matrix is not None), np.eye(3)]
        )
        numbers = itertools.count(len(motions))  # constants follow the motions, the identity comes last
        turns = [
            [s.number if s.matrix is None else next(numbers) for s in own if s.kind != "translate"] for own in steps
        ]
        identity, most = next(numbers), max(1, *(len(own) for own in turns))
        self.factors = np.array([turns[j] + [identity] * (most - len(turns[j])) for j in order]).T
        self.offsets = np.zeros((len(order), 3, 1))
        has_bone = np.flatnonzero(skeleton.bone_axes[order] >= 0)
        self.offsets[has_bone, skeleton.bone_axes[order][has_bone], 0] = skeleton.bones[order][has_bone]
        self.slides = [
            (i, s.axis, s.sign, s.number) for i, j in enumerate(order) for s in steps[j] if s.kind == "translate"
        ]
        ends = np.cumsum(np.bincount(skeleton.carries.sum(axis=0))[1:])  # of each depth
        self.roots = int(ends[0])
        # What a pose with axes needs beside: in order of depth, and per motion its joint, slot, axis and sign.
        self.order, self.parents = order, np.where(skeleton.parents[order] < 0, -1, self.place[skeleton.parents[order]])
        self.bone_axes = np.zeros((len(order), 3, 1))
        self.bone_axes[has_bone, skeleton.bone_axes[order][has_bone], 0] = 1
        self.motions = _places_of(steps, self.place)
        self.depths = [
            (slice(first, last), self.place[skeleton.parents[order[first:last]]])
            for first, last in itertools.pairwise(ends)
        ]

    def joints(self, value: Array) -> Array:
        """Positions (N, K, 3) for the values (N, M) of the motions."""
        return self._world(value, self.offsets)[0][..., :3, 3][:, self.place]

    def pose(self, value: Array, free: Array, bones: Array | None, dtype: DTypeLike) -> Pose:
        """Joints, frames, and the axes of the motions ``free`` (Q,); ``bones`` (N, K) are each pose's own lengths."""
        offsets = self.offsets
        if bones is not None:
            offsets = self.bone_axes * bones[:, self.order, None, None]
        world, turns, start = self._world(value, offsets)
        pose = Pose(0, 0, 0)
        pose.joints = world[..., :3, 3][:, self.place].astype(dtype)
        pose.frames = world[..., :3, :3][:, self.place].astype(dtype)
        joint, slot, axis, sign = (column[free] for column in self.motions)
        around = np.concatenate([np.broadcast_to(np.eye(4), (len(value), 1, 4, 4)), world], axis=1)
        parent = around[:, self.parents[joint] + 1]  # of a root: the world
        turned = np.stack([np.broadcast_to(np.eye(3), turns[-1].shape), *turns])
        own = turned[slot, :, joint, :, axis].swapaxes(0, 1) * sign[:, None]
        pose.axis = (parent[..., :3, :3] @ own[..., None])[..., 0].astype(dtype)
        at = parent[..., :3, 3] + (parent[..., :3, :3] @ start[:, joint, :, None])[..., 0]
        pose.pivot = at.astype(dtype)
        return pose

    def _world(self, value: Array, offsets: Array) -> tuple[Array, list[Array], Array]:
        """World transforms (N, K, 4, 4) in order of depth; each joint's turns after every one of its factors,

        (N, K, 3, 3) each, and how far it has slid before it turns, (N, K, 3), both in its parent's frame.
        """
        N, K = len(value), len(self.place)
        R = self.P + np.cos(value)[..., None, None] * self.C + np.sin(value)[..., None, None] * self.S
        R = np.concatenate([R, np.broadcast_to(self.constants, (N, *self.constants.shape))], axis=1)
        turn = R[:, self.factors[0]]
        turns = [turn]
        for factor in self.factors[1:]:
            turn = turn @ R[:, factor]
            turns.append(turn)
        start = np.zeros((N, K, 3))
        for i, axis, sign, row in self.slides:
            start[:, i, axis] += sign * value[:, row]
        local = np.zeros((N, K, 4, 4))
        local[..., :3, :3] = turn
        np.matmul(turn, offsets, out=local[..., :3, 3:])
        local[..., :3, 3] += start
        local[..., 3, 3] = 1
        world = np.empty((N, K, 4, 4))
        world[:, : self.roots] = local[:, : self.roots]
        for rows, parents in self.depths:
            np.matmul(world[:, parents], local[:, rows], out=world[:, rows])
        return world, turns, start


def _steps(skeleton: Skeleton) -> list[list[Part]]:
    """Every joint's operations in order; fixed rotations are multiplied out."""
    row, result = 0, []
    for motions in skeleton.motions:
        own: list[Part] = []
        for m in motions:
            if m.kind == "rotate" and skeleton.fixed[m.dof]:
                matrix = rotation(m.axis, m.sign * skeleton.initial[m.dof])
                if own and own[-1].matrix is not None:
                    matrix = own.pop().matrix @ matrix
                own.append(Part("constant", matrix=matrix))
            else:
                own.append(Part(m.kind, m.axis, m.sign, row, m.dof))
                row += 1
        result.append(own)
    return result


def _groups(
    skeleton: Skeleton, steps: list[list[Part]], dtype: DTypeLike
) -> tuple[list[Group], dict[int, tuple[int, int]]]:
    """Joints that can be computed together, parents first; and the (group, slot) of every joint."""
    parents, depth = skeleton.parents, skeleton.carries.sum(axis=0)
    alike: dict[object, list[int]] = {}
    places: dict[int, tuple[int, int]] = {}
    for j in skeleton.order:
        kinds = tuple((step.kind, step.axis) for step in steps[j])
        alike.setdefault((depth[j], kinds, max(skeleton.bone_axes[j], 0)), []).append(j)
    groups: list[Group] = []
    for same in alike.values():  # depth by depth
        by_parent: dict[int, list[int]] = {}
        for j in same:
            by_parent.setdefault(places[int(parents[j])][0] if parents[j] >= 0 else -1, []).append(j)
        for parent, joints in by_parent.items():
            slots = [places[int(parents[j])][1] if parent >= 0 else 0 for j in joints]
            together = [_together(same_step, dtype) for same_step in zip(*(steps[j] for j in joints))]
            places.update({j: (len(groups), slot) for slot, j in enumerate(joints)})
            bodies = [_as_slice(np.flatnonzero(skeleton.carries[j]).tolist()) for j in joints if parent < 0]
            axis = int(max(skeleton.bone_axes[joints[0]], 0))
            groups.append(Group(joints, parent, _as_slice(slots), together, axis, bodies))
    return groups, places


def _together(steps: Sequence[Part], dtype: DTypeLike) -> Operation:
    matrices = [step.matrix for step in steps if step.matrix is not None]
    return Operation(
        kind=steps[0].kind,
        axis=steps[0].axis,
        rows=_as_slice([step.number for step in steps]),
        sign=np.array([step.sign for step in steps], dtype)[:, None, None],
        matrices=np.array(matrices, dtype).reshape(-1, 3, 3),
    )


def _places_of(steps: Sequence[Sequence[Part]], place: Array) -> tuple[Array, Array, Array, Array]:
    """Of every motion, (M,) each: its joint in order of depth, how many factors turn before it, its axis and sign."""
    found = []
    for joint, own in enumerate(steps):
        turned = 0
        for step in own:
            if step.kind != "constant":
                found.append((place[joint], 0 if step.kind == "translate" else turned, step.axis, step.sign))
            turned += step.kind != "translate"
    joints, slots, axes, signs = zip(*found) if found else ((), (), (), ())
    return np.array(joints, int), np.array(slots, int), np.array(axes, int), np.array(signs, float)


def _rodrigues(motions: Sequence[Part]) -> tuple[Array, Array, Array]:
    """P, C, S (M, 3, 3) with R(t) = P + cos t C + sin t S; the identity for a translation."""
    P, C, S = np.zeros((3, len(motions), 3, 3))
    for q, step in enumerate(motions):
        start, quarter, half = (rotation(step.axis, step.sign * angle) for angle in (0.0, np.pi / 2, np.pi))
        P[q] = (start + half) / 2
        C[q], S[q] = start - P[q], quarter - P[q]
    return P, C, S


def _as_slice(indices: list[int]) -> slice | list[int]:
    """Consecutive indices as a slice, so that indexing with them copies nothing."""
    if indices == list(range(indices[0], indices[0] + len(indices))):
        return slice(indices[0], indices[0] + len(indices))
    return indices


def _turn_constant(frame: list[Array], matrices: Array) -> list[Array]:
    """Right-multiply the frames, three columns of (1 or n, 3, N), by constant ``matrices`` (n, 3, 3)."""
    if len(frame[0]) == 1:  # one parent: all columns of all joints are one product
        N = frame[0].shape[-1]
        columns = matrices.transpose(0, 2, 1).reshape(-1, 3) @ np.concatenate(frame).reshape(3, 3 * N)
        return list(columns.reshape(len(matrices), 3, 3, N).transpose(1, 0, 2, 3))
    return [_combine(matrices[:, :, c], frame) for c in range(3)]


def _combine(weights: Array, columns: list[Array]) -> Array:
    """weights[:, 0] columns[0] + ...: (n, 3) and three (n, 3, N) → (n, 3, N)."""
    a, b, c = (weights[:, m, None, None] * columns[m] for m in range(3))
    return a + b + c


def _cross(a: Array, b: Array, out: Array) -> Array:
    """Cross product along axis 1 of (n, 3, N) arrays."""
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[:, j], b[:, k], out=out[:, i])
        out[:, i] -= a[:, k] * b[:, j]
    return out
