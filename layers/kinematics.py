r"""Skeleton and forward kinematics, with the gradient. Shared by HandModel and PhysLimit.

A skeleton is a table read from a prototxt file (``prototxt/hand/nyu.prototxt`` is the hand of the paper;
any articulated body is another file). Its degrees of freedom (DoF) have the value

    theta[d] = input[d] + initial[d]        (a fixed DoF: theta[d] = initial[d])

Each joint starts from its parent's position p and frame F (a 3x3 rotation, world_from_joint), and in order
    moves      p <- p + F e_axis theta          for each ``translate``
    turns      F <- F R_axis(theta)             for each ``rotate``, right-handed about a local axis
    moves      p <- p + F e_axis length         by its ``bone``
which is the product of 4x4 transforms of the paper's Sec. 3.2, root to tip.

The gradient needs no matrix derivative. A joint at X that turns about the unit axis a through the pivot P
moves with velocity a x (X - P), so with the joint's diff f = dL/dX as a force

    dL/dtheta = sum_j  f_j . (a x (X_j - P))  =  a . sum_j (X_j - P) x f_j
              = a . ( sum_j X_j x f_j  -  P x sum_j f_j )

the torque about the axis, summed over the joints j that the DoF moves. For a translation along a it is
a . sum_j f_j. Both sums are one product with the 0/1 matrix "DoF q moves joint j".

Positions are kept relative to where the root has moved to, and moved there last: the gradient of a hand far away loses
no digits. Everything inside is batch last, (..., N): the innermost loop of every operation is then the batch. Joints of
the same depth and the same sequence of operations (four fingers) go together. Numbers are float64 unless asked
otherwise (``Skeleton.as_type``).
"""

from __future__ import annotations

import copy
import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib import prototxt, schema
from netlib.errors import PrototxtError, did_you_mean
from netlib.paths import find
from netlib.schema import Double

Array = NDArray[Any]
Axis = Literal["X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z"]
FEW = 16  # poses
NYU_HAND = Path(__file__).parent.parent / "prototxt" / "hand" / "nyu.prototxt"


# ---------------------------------------------------------------------------------------------- the file


@dataclass(frozen=True)
class DofParameter:
    """The ``dof { ... }`` of a skeleton file."""

    name: str
    initial: Double = 0.0  # added to the input
    lower: Double = -np.inf  # limits of the input
    upper: Double = np.inf
    fixed: bool = False  # keeps the initial value, ignores the input


@dataclass(frozen=True)
class MotionParameter:
    """The ``rotate { ... }`` or ``translate { ... }`` of a joint: a DoF about or along a local axis."""

    axis: Axis
    dof: str


@dataclass(frozen=True)
class BoneParameter:
    """The ``bone { ... }`` of a joint."""

    axis: Axis
    length: Double


@dataclass(frozen=True)
class JointParameter:
    """The ``joint { ... }`` of a skeleton file."""

    name: str
    parent: str | None = None  # none: starts at the origin
    translate: tuple[MotionParameter, ...] = ()
    rotate: tuple[MotionParameter, ...] = ()
    bone: BoneParameter | None = None


@dataclass(frozen=True)
class SkeletonParameter:
    """A whole skeleton file."""

    name: str = ""
    dof: tuple[DofParameter, ...] = ()
    joint: tuple[JointParameter, ...] = ()  # in output order


class Step(NamedTuple):
    """One operation of one joint."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int = -1  # local axis of a motion
    sign: float = 1.0  # -1: about or along the negative axis
    dof: int = -1  # the free DoF of a motion
    row: int = -1  # the motion's row in Pose.axis and Pose.pivot
    matrix: Array | None = None  # of a constant: fixed rotations, multiplied out


class Operation(NamedTuple):
    """The same step of n joints."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int
    rows: slice | list[int]  # of the motions
    sign: Array  # (n, 1, 1)
    matrices: Array  # (n, 3, 3) of the constants

    def as_type(self, dtype: DTypeLike) -> Operation:
        return self._replace(sign=self.sign.astype(dtype), matrices=self.matrices.astype(dtype))


@dataclass
class Group:
    """Joints of one depth whose steps have the same kinds and axes: they are computed as one array."""

    joints: list[int]
    parent: int  # the group of their parents, -1 for roots
    slots: slice | list[int]  # where the parents stand in that group
    operations: list[Operation]
    bone_axis: int
    bodies: list[slice | list[int]]  # of roots: the joints of each one's body, itself too


@dataclass
class Pose:
    """What ``Skeleton.forward`` found out; ``Skeleton.backward`` needs it again."""

    joints: Array  # (K, 3, N) positions
    local: Array  # (K, 3, N) positions from where the joint's root has moved to
    axis: Array  # (Q, 3, N) world direction of each free motion
    pivot: Array  # (Q, 3, N) a point on each axis, from there too
    frames: list[tuple[Array, Array, Array]]  # per group the columns of world_from_joint, each (joints, 3, N)
    work: tuple[Array, ...] | None = None  # what backward needs for a while


class Skeleton:
    """An articulated body.

    dof_names, joint_names   names in file order: D inputs, K joints
    initial, lower, upper    (D,) float64: offset of the input, limits of the input
    fixed                    (D,) bool: DoFs that ignore their input
    parents                  (K,) index of the parent joint, -1 for a root
    bones                    (K,) signed bone lengths along each joint's bone axis
    bone_axes                (K,) that axis: 0, 1, 2 for x, y, z; -1 without a bone
    steps                    per joint its motions in order, fixed rotations multiplied out to constants
    driven                   (Q,) the DoF of each motion, in the order of ``steps``; a DoF may drive several
    turns                    (Q,) bool: the motion is a rotation, not a translation
    """

    def __init__(self, param: SkeletonParameter) -> None:
        self.param, self.name = param, param.name
        if not param.joint:
            raise PrototxtError(schema.position_of(param), "no joint in this file; expected a skeleton")
        self.dof_names = _unique([(d.name, d) for d in param.dof], "DoF")
        self.joint_names = _unique([(j.name, j) for j in param.joint], "joint")
        self.initial = np.array([d.initial for d in param.dof])
        self.lower = np.array([d.lower for d in param.dof])
        self.upper = np.array([d.upper for d in param.dof])
        self.fixed = np.array([d.fixed for d in param.dof], dtype=bool)
        parts: list[DofParameter | BoneParameter] = [*param.dof, *(j.bone for j in param.joint if j.bone)]
        for part in parts:
            number = part.initial if isinstance(part, DofParameter) else part.length
            if not np.isfinite(number):
                raise PrototxtError(schema.position_of(part), f"{number} is not a length or an angle")
        for d in param.dof:
            if d.lower > d.upper:
                raise PrototxtError(
                    schema.position_of(d), f"DoF {d.name!r}: lower limit {d.lower:g} is above {d.upper:g}"
                )
        self.parents = np.array([self._index(j.parent, self.joint_names, j, "parent") for j in param.joint], dtype=int)
        self.bones = np.array([_signed(j.bone.axis)[1] * j.bone.length if j.bone else 0.0 for j in param.joint])
        self.bone_axes = np.array([_signed(j.bone.axis)[0] if j.bone else -1 for j in param.joint])
        lineage = [self._lineage(j, param.joint) for j in range(len(param.joint))]
        self.steps = steps = self._steps(param.joint)
        self._groups, self._places = _groups(param.joint, self.parents, lineage, steps)
        motions = [(j, step) for j, own in enumerate(steps) for step in own if step.kind != "constant"]
        self.driven = np.array([step.dof for _, step in motions], dtype=int)
        self.turns = np.array([step.kind == "rotate" for _, step in motions], dtype=bool)
        self._slides = np.flatnonzero(~self.turns)
        moves = [float(j in way) for j, _ in motions for way in lineage]
        self._moves = np.array(moves).reshape(len(motions), len(lineage))
        self._few = _FewPoses(self.parents, [len(way) for way in lineage], steps, self.bone_axes, self.bones)
        self._repeats = len(set(self.driven.tolist())) < len(self.driven)
        self._dtype: np.dtype[Any] = np.dtype(np.float64)

    def as_type(self, dtype: DTypeLike) -> Skeleton:
        """This skeleton, with ``forward`` and ``backward`` in ``dtype``: a batch in float32 takes half the time."""
        other = copy.copy(self)
        other._dtype = np.dtype(dtype)  # of the arithmetic
        other._moves = self._moves.astype(dtype)
        other._groups = [replace(group, operations=[op.as_type(dtype) for op in group.operations])
                         for group in self._groups]  # fmt: skip
        return other

    def _index(self, name: str | None, known: list[str], owner: object, field: str) -> int:
        """Index of a name; -1 for none."""
        if name is None:
            return -1
        if name not in known:
            where = schema.position_of(owner, field)
            raise PrototxtError(where, f"unknown {field} {name!r}{did_you_mean(name, known)}")
        return known.index(name)

    def _lineage(self, joint: int, params: Sequence[JointParameter]) -> list[int]:
        """The joint, its parent, and so on to its root."""
        way = [joint]
        while self.parents[way[-1]] >= 0:
            way.append(int(self.parents[way[-1]]))
            if len(way) > len(self.parents):
                stuck = params[way[-1]]
                raise PrototxtError(schema.position_of(stuck), f"joint {stuck.name!r} is its own ancestor")
        return way

    def _steps(self, joints: Sequence[JointParameter]) -> list[list[Step]]:
        """Every joint's operations in order; fixed rotations are multiplied out."""
        row, result = 0, []
        for joint in joints:
            own: list[Step] = []
            for kind, motion in [("translate", m) for m in joint.translate] + [("rotate", m) for m in joint.rotate]:
                axis, sign = _signed(motion.axis)
                dof = self._index(motion.dof, self.dof_names, motion, "dof")
                if kind == "rotate" and self.fixed[dof]:
                    matrix = rotation(axis, sign * self.initial[dof])
                    before = own[-1].matrix if own else None
                    if before is not None:
                        own.pop()
                        matrix = before @ matrix
                    own.append(Step("constant", matrix=matrix))
                else:
                    own.append(Step("rotate" if kind == "rotate" else "translate", axis, sign, dof, row))
                    row += 1
            result.append(own)
        return result

    # ------------------------------------------------------------------------------------------ motion

    def theta(self, inputs: NDArray[np.floating]) -> Array:
        """DoF values (N, D) of the inputs (N, D)."""
        return np.asarray(np.where(self.fixed, 0.0, inputs) + self.initial, dtype=np.float64)

    def joints(self, inputs: NDArray[np.floating], bones: Array | None = None) -> Array:
        """Joint positions (N, K, 3) of the inputs (N, D), in the unit of the bones."""
        if bones is None and len(inputs) <= FEW:
            return self._few.joints(self.theta(inputs)[:, self.driven]).astype(self._dtype)
        return self.forward(inputs, bones).joints.transpose(2, 0, 1)

    def forward(self, inputs: NDArray[np.floating], bones: Array | None = None, reuse: Pose | None = None) -> Pose:
        """Pose of each row of ``inputs`` (N, D). ``bones`` (N, K) gives every row its own bone lengths.

        ``reuse`` is a pose that is needed no more; its arrays are written over if they fit.
        """
        N = len(inputs)
        theta = np.array(inputs.T, dtype=self._dtype, order="C")
        theta[self.fixed] = 0.0
        theta += self.initial[:, None]
        value = theta[self.driven]  # (Q, N)
        cos, sin = np.cos(value), np.sin(value)
        if reuse is not None and (reuse.joints.shape[-1], reuse.joints.dtype) == (N, self._dtype):
            X, local, axis, pivot = reuse.joints, reuse.local, reuse.axis, reuse.pivot
        else:
            counts = [len(self.parents)] * 2 + [len(self.driven)] * 2
            X, local, axis, pivot = (np.empty((count, 3, N), self._dtype) for count in counts)
        frames: list[tuple[Array, Array, Array]] = []
        lengths = np.asarray(self.bones[:, None] if bones is None else bones.T, dtype=self._dtype)
        origin = [np.broadcast_to(e[None, :, None], (1, 3, N)) for e in np.eye(3, dtype=self._dtype)]
        for group in self._groups:
            p = start = np.zeros((1, 3, 1), self._dtype)
            if group.parent < 0:
                frame = list(origin)
            else:
                frame = [column[group.slots] for column in frames[group.parent]]
                p = local[self._groups[group.parent].joints][group.slots]
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
            frames.append((frame[0], frame[1], frame[2]))
        X += local
        return Pose(X, local, axis, pivot, frames, reuse.work if reuse is not None and X is reuse.joints else None)

    def backward(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, D) at the inputs, given the gradient ``dX`` (K, 3, N) at the joints. Fixed DoFs: 0."""
        K, _, N = pose.joints.shape
        if pose.work is None:  # large arrays are slow to get anew
            pose.work = (*(np.empty_like(pose.pivot) for _ in range(3)), np.empty_like(pose.joints))
        force, torque, offset, turning = pose.work
        np.matmul(self._moves, dX.reshape(K, 3 * N), out=force.reshape(len(force), 3 * N))
        np.matmul(
            self._moves, _cross(pose.local, dX, turning).reshape(K, 3 * N), out=torque.reshape(len(torque), 3 * N)
        )
        torque -= _cross(pose.pivot, force, offset)
        torque[self._slides] = force[self._slides]
        torque *= pose.axis
        gradient = np.zeros((len(self.initial), N), self._dtype)
        if self._repeats:  # one DoF drives several joints
            np.add.at(gradient, self.driven, torque.sum(axis=1))
        else:
            gradient[self.driven] = torque.sum(axis=1)
        gradient[self.fixed] = 0
        return gradient.T

    def jacobian(self, pose: Pose, joints: Sequence[int] | None = None) -> Array:
        """(N, Q, 3 K): how each of ``joints`` (all by default), x y z of one after the other, moves with each motion.

        a x (X - P) for a turn about the axis a through P, and a for a translation along a; 0 for joints not moved.
        """
        chosen = list(range(len(self.parents))) if joints is None else list(joints)
        Q, _, N = pose.axis.shape
        X, a, P = pose.local[chosen], pose.axis[:, None], pose.pivot[:, None]
        arm = np.where(self.turns[:, None, None, None], X - P, 0.0)
        J = np.empty((Q, len(chosen), 3, N))
        for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
            J[:, :, i] = a[:, :, j] * arm[:, :, k] - a[:, :, k] * arm[:, :, j]
        J[~self.turns] = a[~self.turns]
        J *= self._moves[:, chosen, None, None]
        return J.reshape(Q, -1, N).transpose(2, 0, 1)

    def bone_directions(self, pose: Pose) -> Array:
        """(K, 3, N): how each joint, and all below it, moves as its signed bone grows; 0 for a joint without a bone."""
        directions = np.zeros_like(pose.joints)
        for group, frame in zip(self._groups, pose.frames):
            directions[group.joints] = frame[group.bone_axis]
        directions[self.bone_axes < 0] = 0
        return directions

    def rotation_of(self, pose: Pose, joint: int) -> Array:
        """world_from_joint of one joint, (N, 3, 3)."""
        group, slot = self._places[joint]
        columns = [np.broadcast_to(c[slot], pose.joints.shape[1:]) for c in pose.frames[group]]
        return np.stack(columns, axis=1).transpose(2, 0, 1)


class _FewPoses:
    """Forward kinematics for a few poses, where the number of NumPy calls counts and not the arithmetic.

    A turn about a fixed axis is R(t) = P + cos t C + sin t S with constant matrices (Rodrigues), so all turns of a pose
    come from three operations. All joints multiply their own turns and their bone to a 4 x 4 transform at once; then
    one product for each depth hangs the joints of that depth to their parents. Joints are in order of depth in here.
    """

    def __init__(
        self,
        parents: NDArray[np.int_],
        depths: Sequence[int],
        steps: Sequence[Sequence[Step]],
        bone_axes: NDArray[np.int_],
        bones: Array,
    ) -> None:
        order = np.argsort(depths, kind="stable")
        self.place = np.argsort(order)  # of each joint
        motions = [step for own in steps for step in own if step.kind != "constant"]
        self.P, self.C, self.S = _rodrigues(motions)
        constants = [step.matrix for own in steps for step in own if step.matrix is not None]
        self.constants = np.array([*constants, np.eye(3)])
        number = {id(matrix): len(motions) + i for i, matrix in enumerate(constants)}
        identity = len(motions) + len(constants)
        turns = [[number.get(id(s.matrix), s.row) for s in steps[j] if s.kind != "translate"] for j in order]
        most = max(1, *(len(own) for own in turns))
        self.factors = np.array([own + [identity] * (most - len(own)) for own in turns]).T
        self.offsets = np.zeros((len(order), 3, 1))
        has_bone = np.flatnonzero(bone_axes[order] >= 0)
        self.offsets[has_bone, bone_axes[order][has_bone], 0] = bones[order][has_bone]
        self.slides = [
            (i, s.axis, s.sign, s.row) for i, j in enumerate(order) for s in steps[j] if s.kind == "translate"
        ]
        ends = np.cumsum(np.bincount(depths)[1:])
        self.roots = int(ends[0])
        self.depths = [
            (slice(first, last), self.place[parents[order[first:last]]]) for first, last in itertools.pairwise(ends)
        ]

    def joints(self, value: Array) -> Array:
        """Positions (N, K, 3) for the values (N, Q) of the free motions."""
        N, K = len(value), len(self.place)
        R = self.P + np.cos(value)[..., None, None] * self.C + np.sin(value)[..., None, None] * self.S
        R = np.concatenate([R, np.broadcast_to(self.constants, (N, *self.constants.shape))], axis=1)
        turn = R[:, self.factors[0]]
        for factor in self.factors[1:]:
            turn = turn @ R[:, factor]
        local = np.zeros((N, K, 4, 4))
        local[..., :3, :3] = turn
        np.matmul(turn, self.offsets, out=local[..., :3, 3:])
        local[..., 3, 3] = 1
        for i, axis, sign, row in self.slides:
            local[:, i, axis, 3] += sign * value[:, row]
        world = np.empty((N, K, 4, 4))
        world[:, : self.roots] = local[:, : self.roots]
        for rows, parents in self.depths:
            np.matmul(world[:, parents], local[:, rows], out=world[:, rows])
        return world[..., :3, 3][:, self.place]


def _groups(
    params: Sequence[JointParameter], parents: NDArray[np.int_], lineage: list[list[int]], steps: list[list[Step]]
) -> tuple[list[Group], dict[int, tuple[int, int]]]:
    """Joints that can be computed together, parents first; and the (group, slot) of every joint."""
    alike: dict[object, list[int]] = {}
    places: dict[int, tuple[int, int]] = {}
    for j in sorted(range(len(params)), key=lambda j: len(lineage[j])):
        bone = params[j].bone
        key = (len(lineage[j]), [(step.kind, step.axis) for step in steps[j]], _signed(bone.axis)[0] if bone else 0)
        alike.setdefault(repr(key), []).append(j)
    groups: list[Group] = []
    for same in alike.values():  # depth by depth
        by_parent: dict[int, list[int]] = {}
        for j in same:
            by_parent.setdefault(places[int(parents[j])][0] if parents[j] >= 0 else -1, []).append(j)
        for parent, joints in by_parent.items():
            slots = [places[int(parents[j])][1] if parent >= 0 else 0 for j in joints]
            together = [_together(same_step) for same_step in zip(*(steps[j] for j in joints))]
            bone = params[joints[0]].bone
            axis = _signed(bone.axis)[0] if bone else 0
            places.update({j: (len(groups), slot) for slot, j in enumerate(joints)})
            bodies = [_as_slice([k for k, way in enumerate(lineage) if way[-1] == j]) for j in joints if parent < 0]
            groups.append(Group(joints, parent, _as_slice(slots), together, axis, bodies))
    return groups, places


def _together(steps: Sequence[Step]) -> Operation:
    matrices = [step.matrix for step in steps if step.matrix is not None]
    return Operation(
        kind=steps[0].kind,
        axis=steps[0].axis,
        rows=_as_slice([step.row for step in steps]),
        sign=np.array([step.sign for step in steps])[:, None, None],
        matrices=np.array(matrices).reshape(-1, 3, 3),
    )


def _rodrigues(motions: Sequence[Step]) -> tuple[Array, Array, Array]:
    """P, C, S (Q, 3, 3) with R(t) = P + cos t C + sin t S; the identity for a translation."""
    P, C, S = np.zeros((3, len(motions), 3, 3))
    for q, step in enumerate(motions):
        start, quarter, half = (rotation(step.axis, step.sign * angle) for angle in (0.0, np.pi / 2, np.pi))
        P[q] = (start + half) / 2
        C[q], S[q] = start - P[q], quarter - P[q]
    return P, C, S


def rotation(axis: int, angle: float) -> Array:
    """Right-handed rotation (3, 3) about a coordinate axis (0, 1, 2 for x, y, z)."""
    R, i, j = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def load(path: str | Path = NYU_HAND) -> Skeleton:
    """The skeleton of a file; by default the NYU hand. Raises PrototxtError, NetlibError."""
    return _load(Path(path), Path(path).resolve())


@functools.lru_cache(maxsize=16)
def _load(path: Path, whole_path: Path) -> Skeleton:
    """``load``; the whole path tells apart files of the same relative name."""
    return Skeleton(schema.read(prototxt.parse_file(path), SkeletonParameter, f"skeleton {path}"))


def load_for(name: str, source: str | None) -> Skeleton:
    """The skeleton that the prototxt ``source`` names; the NYU hand if it names none."""
    return load(find(name, source) if name else NYU_HAND)


def _unique(named: list[tuple[str, object]], what: str) -> list[str]:
    seen: set[str] = set()
    for name, param in named:
        if name in seen:
            raise PrototxtError(schema.position_of(param), f"{what} {name!r} is defined twice")
        seen.add(name)
    return [name for name, _ in named]


def _signed(axis: Axis) -> tuple[int, float]:
    return "XYZ".index(axis[-1]), -1.0 if axis.startswith("NEG_") else 1.0


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
