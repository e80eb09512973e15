# Write what raises NotImplementedError, then: python tools/exercise.py torque_gradient
r"""Forward kinematics of a skeleton (the paper's Sec. 3.1 and Appendix), and its gradient by torques.

From the root outwards, parents before children, each joint j starts from its parent's position p and frame
F = world_from_parent, a 3 x 3 rotation, and in order

    translates   p <- p + F e_axis theta          for each ``translate``
    turns        F <- F R_axis(theta)             for each ``rotate``: F is world_from_joint then
    moves        X_j = p + F e_axis length        by its ``bone``

which is the product of 4 x 4 transforms in the paper's Eq. 4, root to tip. theta is the input plus a constant, so the
gradient at the input is dL/dtheta.

The gradient needs no derivative of a matrix. A joint at X that turns about the unit axis a through the pivot P moves
with velocity a x (X - P). With the gradient f_k = dL/dX_k of every joint as a force on it,

    dL/dtheta = sum_k  f_k . (a x (X_k - P))  =  a . sum_k (X_k - P) x f_k        over the joints k that hang on j

is the torque about the axis. So forces and torques are summed from the tips inwards, children before parents, as for a
robot's arm:

    force_j   = f_j + sum of force_c                                over the children c of j
    torque_j  = sum of (torque_c + (X_c - X_j) x force_c)           about X_j

    dL/dtheta = a . (torque_j + (X_j - P) x force_j)    of a turn about a through P
    dL/dtheta = a . force_j                             of a translation along a

A bone is a translation, too: a longer one carries its joint, and all joints that hang on it, along its axis a,

    dL/dlength = a . force_j                            of joint j's bone
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike

from layers.hand.skeleton import Skeleton
from netlib.blob import Array


class Pose:
    """What ``Kinematics.forward`` found for N poses, with K joints and Q free motions."""

    def __init__(self, N: int, K: int, Q: int) -> None:
        self.joints: Array = np.zeros((N, K, 3))  # positions
        self.frames: Array = np.zeros((N, K, 3, 3))  # world_from_joint
        self.axis: Array = np.zeros((N, Q, 3))  # world direction of each free motion
        self.pivot: Array = np.zeros((N, Q, 3))  # a point on each axis


class Kinematics:
    """Where the joints of a skeleton are, and how they move. Computes in float64, answers in ``dtype``."""

    def __init__(self, skeleton: Skeleton, dtype: DTypeLike = np.float64) -> None:
        self.skeleton, self.dtype = skeleton, np.dtype(dtype)

    def forward(self, inputs: Array, bones: Array | None = None) -> Pose:
        """Pose of each row of ``inputs`` (N, D). ``bones`` (N, K) gives every row its own signed bone lengths."""
        sk, theta = self.skeleton, self.skeleton.theta(inputs)
        lengths = np.broadcast_to(sk.bones if bones is None else bones, (len(theta), len(sk.bones)))
        pose = Pose(len(theta), len(sk.bones), len(sk.driven))
        for j in sk.order:
            parent = sk.parents[j]
            p = pose.joints[:, parent] if parent >= 0 else np.zeros((len(theta), 3))
            F = pose.frames[:, parent] if parent >= 0 else np.broadcast_to(np.eye(3), (len(theta), 3, 3))
            for motion in sk.motions[j]:
                a = motion.sign * F[:, :, motion.axis]
                if motion.row >= 0:
                    pose.axis[:, motion.row], pose.pivot[:, motion.row] = a, p
                if motion.kind == "translate":
                    p = p + a * theta[:, motion.dof, None]
                else:
                    F = F @ rotation(motion.axis, motion.sign * theta[:, motion.dof])
            along_bone = F[:, :, sk.bone_axes[j]]  # without a bone any axis, times 0
            pose.joints[:, j], pose.frames[:, j] = p + along_bone * lengths[:, j, None], F
        return pose

    def glance(self, inputs: Array, bones: Array | None = None) -> Pose:
        """``forward`` for who looks at joints, axes and rotations only: not for ``backward``."""
        return self.forward(inputs, bones)

    def backward(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, D) at the inputs, given the gradient ``dX`` (N, K, 3) at the joints. Fixed DoFs: 0."""
        # Return dtheta (N, D) in self.dtype. Begin with force = a float64 copy of dX and torque = 0, and walk over
        # reversed(skeleton.order), so that a joint has the sums of its children before it is asked. For each of its
        # motions with motion.row >= 0 (the others are fixed) add to dtheta[:, motion.dof]; a is pose.axis[:, row], P
        # is pose.pivot[:, row], and a DoF may drive several motions. Then add the joint's force and torque to its
        # parent's. np.cross(u, v) works along the last axis.
        raise NotImplementedError

    def backward_bones(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, K) at the signed bone lengths. Joints without a bone: 0."""
        force = self.skeleton.carries @ dX.astype(np.float64)
        return np.asarray((self.bone_directions(pose) * force).sum(axis=2), dtype=self.dtype)

    def joints(self, inputs: Array, bones: Array | None = None) -> Array:
        """Joint positions (N, K, 3) of the inputs (N, D), in the unit of the bones."""
        return np.asarray(self.forward(inputs, bones).joints, dtype=self.dtype)

    def jacobian(self, pose: Pose, joints: Sequence[int] | None = None) -> Array:
        """(N, Q, 3 k): how each of the k ``joints`` (all by default), x y z of one after the other, moves with each
        free motion: a x (X - P) for a turn about the axis a through P, a for a translation along a.
        """
        sk = self.skeleton
        chosen = list(range(len(sk.parents))) if joints is None else list(joints)
        axis = pose.axis[:, :, None]
        arm = pose.joints[:, None, chosen] - pose.pivot[:, :, None]
        J = np.where(sk.turns[:, None, None], np.cross(axis, arm), axis) * sk.moves[:, chosen, None]
        return np.asarray(J.reshape(*J.shape[:2], 3 * len(chosen)))

    def bone_directions(self, pose: Pose) -> Array:
        """(N, K, 3): how each joint, and all below it, moves as its signed bone grows; 0 for a joint without a bone."""
        sk = self.skeleton
        directions = pose.frames[:, np.arange(len(sk.bone_axes)), :, sk.bone_axes].swapaxes(0, 1)
        return np.asarray(directions * (sk.bone_axes >= 0)[:, None])

    def axes(self, pose: Pose) -> tuple[Array, Array]:
        """Of each free motion, the unit vector of its axis in the world and a point on it, (N, Q, 3) and (N, Q, 3)."""
        return pose.axis, pose.pivot

    def rotation_of(self, pose: Pose, joint: int) -> Array:
        """world_from_joint of one joint, (N, 3, 3)."""
        return np.asarray(pose.frames[:, joint])


def rotation(axis: int, angle: Array | float) -> Array:
    """Rotations (..., 3, 3) by ``angle`` (...) about a coordinate axis (0, 1, 2 for x, y, z).

    The textbook's matrices: about z, x turns to y, and so on round. Our axes, x right, y up, z away, are left-handed,
    so the right-hand rule gives the other way.
    """
    i, j, cos, sin = (axis + 1) % 3, (axis + 2) % 3, np.cos(angle), np.sin(angle)
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., axis, axis] = 1
    R[..., i, i], R[..., i, j] = cos, -sin
    R[..., j, i], R[..., j, j] = sin, cos
    return R
