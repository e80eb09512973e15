"""Forward kinematics of a few poses, whose time depends on the number of NumPy calls, not on the
arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike

from fast.joint_steps import JointStep
from layers.hand.kinematics import Pose, rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


class FewPoses:
    """Computes all rotations of a pose together, then the transforms of all joints together.

    A rotation about a fixed axis is R(t) = P + cos t C + sin t S with constant matrices
    (Rodrigues), so three operations compute all rotations of a pose. The rotations and the bone of
    each joint give a 4 x 4 transform. It is multiplied from the left by the transform of the
    parent, then by the result of the grandparent, then of the fourth ancestor, and so on
    (pointer doubling): the number of products is the number of bits of the depth.
    """

    def __init__(self, skeleton: Skeleton, steps: Sequence[Sequence[JointStep]]) -> None:
        K = len(steps)
        M = sum(step.kind != "constant" for own in steps for step in own)
        most = max(1, *(sum(step.kind != "translate" for step in own) for own in steps))
        # rotations of every joint, padded with the identity
        self.P, self.C, self.S = np.zeros((3, most, K, 3, 3))
        self.P[:] = np.eye(3)
        self.angle = np.full((most, K), M)  # index of the motion of each rotation; M: none
        self.slides: list[tuple[int, int, float, int]] = []  # joint, axis, sign, motion
        motions = []  # per motion: joint, number of the joint's rotations before it, axis, sign
        for j, own in enumerate(steps):
            turned = 0  # rotations of the joint so far; translations come before them
            for step in own:
                if step.matrix is None:
                    motions.append((j, turned, step.axis, step.sign))
                if step.kind == "translate":
                    self.slides.append((j, step.axis, step.sign, step.number))
                    continue
                if step.matrix is not None:
                    self.P[turned, j] = step.matrix
                else:
                    self.P[turned, j], self.C[turned, j], self.S[turned, j] = _rodrigues(step)
                    self.angle[turned, j] = step.number
                turned += 1
        self.motions = np.array(motions, dtype=int).reshape(-1, 4).T
        self.bone_axes = _bone_axes(skeleton)
        self.bones = self.bone_axes * skeleton.bones[:, None, None]
        parents = np.where(skeleton.parents < 0, K, skeleton.parents)
        self.parents = np.append(parents, K)  # K is the world
        self.before = _ancestors(self.parents)

    def joints(self, value: Array, bones: Array | None) -> Array:
        """Positions (N, K, 3) for the values (N, M) of the motions; ``bones`` (N, K) are bone
        lengths per pose.
        """
        return self._world(value, bones)[0][:, :-1, :3, 3]

    def pose(self, value: Array, free: Array, bones: Array | None, dtype: DTypeLike) -> Pose:
        """Joints, frames, and the axes of the motions ``free`` (Q,); ``bones`` (N, K) are bone
        lengths per pose.
        """
        world, turns, start = self._world(value, bones)
        joint, slot, axis, sign = self.motions[:, free]
        parent = world[:, self.parents[joint]]
        own = turns[slot, :, joint, :, axis].swapaxes(0, 1) * sign[:, None]
        pose = Pose(0, 0, 0)
        pose.joints = world[:, :-1, :3, 3].astype(dtype)
        pose.frames = world[:, :-1, :3, :3].astype(dtype)
        in_parent = np.stack([own, start[:, joint]], axis=-1)
        both = parent[..., :3, :3] @ in_parent
        pose.axis = both[..., 0].astype(dtype)
        pose.pivot = (parent[..., :3, 3] + both[..., 1]).astype(dtype)
        return pose

    def _world(self, value: Array, bones: Array | None) -> tuple[Array, Array, Array]:
        """World transforms (N, K + 1, 4, 4), the last one the identity, and in the frame of each
        joint's parent

        turns  (F + 1, N, K, 3, 3) rotation of the joint before each of its F factors, and
               after all of them
        start  (N, K, 3) translation of the joint before its rotations
        """
        N, K = len(value), len(self.bone_axes)
        turns = self._turns(value)
        start = np.zeros((N, K, 3))
        for j, axis, sign, row in self.slides:
            start[:, j, axis] += sign * value[:, row]
        world = np.zeros((N, K + 1, 4, 4))
        world[:, :-1, :3, :3] = turns[-1]
        offsets = self.bones if bones is None else self.bone_axes * bones[..., None, None]
        turned = turns[-1] @ offsets
        world[:, :-1, :3, 3] = turned[..., 0] + start
        world[:, -1, [0, 1, 2], [0, 1, 2]] = 1
        world[..., 3, 3] = 1
        for before in self.before:
            world = world[:, before] @ world
        return world, turns, start

    def _turns(self, value: Array) -> Array:
        """The first of the arrays of ``_world``."""
        angle = np.zeros((len(value), value.shape[1] + 1))  # 0 at the end, for no rotation
        angle[:, :-1] = value
        cos, sin = (f(angle)[:, self.angle][..., None, None] for f in (np.cos, np.sin))
        R = cos * self.C
        R += sin * self.S
        R += self.P
        turns = np.empty((len(self.angle) + 1, len(value), *R.shape[2:]))
        turns[0] = np.eye(3)
        turns[1] = R[:, 0]
        for f in range(1, len(self.angle)):
            np.matmul(turns[f], R[:, f], out=turns[f + 1])
        return turns


def _bone_axes(skeleton: Skeleton) -> Array:
    """The axis (K, 3, 1) of each bone in the frame of its joint; 0 without a bone."""
    axes = np.zeros((len(skeleton.bone_axes), 3, 1))
    has_bone = np.flatnonzero(skeleton.bone_axes >= 0)
    axes[has_bone, skeleton.bone_axes[has_bone], 0] = 1
    return axes


def _ancestors(parents: Array) -> list[Array]:
    """The parents (K + 1,), the grandparents, the fourth ancestors and so on, until all are the
    world, K.
    """
    world = len(parents) - 1
    found = []
    while (parents < world).any():
        found.append(parents)
        parents = parents[parents]
    return found


def _rodrigues(step: JointStep) -> tuple[Array, Array, Array]:
    """P, C, S (3, 3) of a rotation R(t) = P + cos t C + sin t S."""
    angles = 0.0, np.pi / 2, np.pi
    start, quarter, half = (rotation(step.axis, step.sign * angle) for angle in angles)
    P = (start + half) / 2
    return P, start - P, quarter - P
