r"""Forward kinematics of a skeleton (Sec. 3.1 and Appendix of the paper), and its
gradient by torques.

From the root outwards, parents before children, each joint j starts from its parent's position p
and frame F = world_from_parent, a 3 x 3 rotation, and applies in order

    translations  p <- p + F e_axis theta          for each ``translate``
    rotations     F <- F R_axis(theta)             for each ``rotate``; gives world_from_joint
    its bone      X_j = p + F e_axis length

This is the product of 4 x 4 transforms in Eq. 4 of the paper, from root to tip. theta is the input
plus a constant, so the gradient with respect to the input is dL/dtheta.

The gradient needs no derivative of a matrix. A joint at X that rotates about the unit axis a
through the pivot P moves with velocity a x (X - P). If the gradient f_k = dL/dX_k of every joint is
treated as a force on it, then

    dL/dtheta = sum_k  f_k . (a x (X_k - P))  =  a . sum_k (X_k - P) x f_k
                over j and its descendants k

is the torque about the axis. Forces and torques are therefore summed from the tips inwards,
children before parents, as in robot dynamics:

    force_j   = f_j + sum of force_c                                over the children c of j
    torque_j  = sum of (torque_c + (X_c - X_j) x force_c)
                about X_j, over the children c of j

    dL/dtheta = a . (torque_j + (X_j - P) x force_j)    for a rotation about a through P
    dL/dtheta = a . force_j                             for a translation along a

A bone acts like a translation: making it longer moves its joint and all descendants
along its axis a,

    dL/dlength = a . force_j                            for joint j's bone
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike

from layers.hand.skeleton import Skeleton
from netlib.blob import Array


class Pose:
    """Result of ``Kinematics.forward`` for N poses, with K joints and Q free motions."""

    def __init__(self, N: int, K: int, Q: int) -> None:
        self.joints: Array = np.zeros((N, K, 3))  # joint positions
        self.frames: Array = np.zeros((N, K, 3, 3))  # world_from_joint
        self.axis: Array = np.zeros((N, Q, 3))  # world direction of each free motion
        self.pivot: Array = np.zeros((N, Q, 3))  # a point on each axis


class Kinematics:
    """Forward kinematics of a skeleton and its gradients.

    Computes in float64, returns ``dtype``.
    """

    def __init__(self, skeleton: Skeleton, dtype: DTypeLike = np.float64) -> None:
        self.skeleton, self.dtype = skeleton, np.dtype(dtype)

    def forward(self, inputs: Array, bones: Array | None = None) -> Pose:
        """Compute the pose for each row of ``inputs`` (N, D).

        ``bones`` (N, K) sets signed bone lengths per row.
        """
        sk, theta = self.skeleton, self.skeleton.theta(inputs)
        N, K = len(theta), len(sk.bones)
        lengths = np.broadcast_to(sk.bones if bones is None else bones, (N, K))
        pose = Pose(N, K, len(sk.driven))
        for j in sk.order:
            parent = sk.parents[j]
            if parent >= 0:
                p, F = pose.joints[:, parent], pose.frames[:, parent]
            else:
                p, F = np.zeros((N, 3)), np.broadcast_to(np.eye(3), (N, 3, 3))
            for motion in sk.motions[j]:
                a = motion.sign * F[:, :, motion.axis]
                if motion.row >= 0:
                    pose.axis[:, motion.row], pose.pivot[:, motion.row] = a, p
                if motion.kind == "translate":
                    p = p + a * theta[:, motion.dof, None]
                else:
                    F = F @ rotation(motion.axis, motion.sign * theta[:, motion.dof])
            # a joint without a bone has length 0, so its axis has no effect
            along_bone = F[:, :, sk.bone_axes[j]]
            pose.joints[:, j] = p + along_bone * lengths[:, j, None]
            pose.frames[:, j] = F
        return pose

    def forward_pose(self, inputs: Array, bones: Array | None = None) -> Pose:
        """Like ``forward``, but without the data that ``backward`` needs."""
        return self.forward(inputs, bones)

    def backward(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, D) with respect to the inputs, from the gradient ``dX`` (N, K, 3) of the
        joints; 0 if fixed.
        """
        sk, X = self.skeleton, pose.joints
        force, torque = np.array(dX, dtype=np.float64), np.zeros(dX.shape)
        dtheta = np.zeros((len(dX), len(sk.initial)))
        for j in reversed(sk.order):
            for motion in sk.motions[j]:
                if motion.row >= 0:
                    a, P = pose.axis[:, motion.row], pose.pivot[:, motion.row]
                    torque_P = torque[:, j] + np.cross(X[:, j] - P, force[:, j])
                    generalized_force = force[:, j] if motion.kind == "translate" else torque_P
                    dtheta[:, motion.dof] += (a * generalized_force).sum(axis=1)
            parent = sk.parents[j]
            if parent >= 0:
                lever = X[:, j] - X[:, parent]
                force[:, parent] += force[:, j]
                torque[:, parent] += torque[:, j] + np.cross(lever, force[:, j])
        return dtheta.astype(self.dtype)

    def backward_bones(self, pose: Pose, dX: Array) -> Array:
        """Gradient (N, K) with respect to the signed bone lengths; 0 for joints without a bone."""
        force = self.skeleton.descendants @ dX.astype(np.float64)
        return np.asarray((self.bone_directions(pose) * force).sum(axis=2), dtype=self.dtype)

    def joints(self, inputs: Array, bones: Array | None = None) -> Array:
        """Joint positions (N, K, 3) for inputs (N, D), in the unit of the bones."""
        return np.asarray(self.forward(inputs, bones).joints, dtype=self.dtype)

    def jacobian(self, pose: Pose, joints: Sequence[int] | None = None) -> Array:
        """Jacobian (N, Q, 3 k) of the k ``joints`` (default all; x y z of one after the other) with
        respect to the free motions: a x (X - P) for a rotation about the axis a through P, a for a
        translation along a.
        """
        sk = self.skeleton
        chosen = list(range(len(sk.parents))) if joints is None else list(joints)
        axis = pose.axis[:, :, None]
        arm = pose.joints[:, None, chosen] - pose.pivot[:, :, None]
        velocity = np.where(sk.turns[:, None, None], np.cross(axis, arm), axis)
        J = velocity * sk.moves[:, chosen, None]
        return np.asarray(J.reshape(*J.shape[:2], 3 * len(chosen)))

    def bone_directions(self, pose: Pose) -> Array:
        """Direction (N, K, 3) in which each joint and its descendants move as its bone grows; 0
        without a bone.
        """
        sk = self.skeleton
        directions = pose.frames[:, np.arange(len(sk.bone_axes)), :, sk.bone_axes].swapaxes(0, 1)
        return np.asarray(directions * (sk.bone_axes >= 0)[:, None])

    def axes(self, pose: Pose) -> tuple[Array, Array]:
        """Unit vector of the axis of each free motion in world coordinates, and a point on it,
        both (N, Q, 3).
        """
        return pose.axis, pose.pivot

    def rotation_of(self, pose: Pose, joint: int) -> Array:
        """The rotation world_from_joint of one joint, (N, 3, 3)."""
        return np.asarray(pose.frames[:, joint])


def rotation(axis: int, angle: Array | float) -> Array:
    """Rotation matrices (..., 3, 3) by ``angle`` (...) about a coordinate axis
    (0, 1, 2 for x, y, z).

    Standard matrices: a rotation about z turns x towards y, and so on cyclically. The axes x right,
    y up, z away are left-handed, so the direction of rotation follows the left-hand rule.
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angle), np.sin(angle)
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., axis, axis] = 1
    R[..., i, i], R[..., i, j] = cos, -sin
    R[..., j, i], R[..., j, j] = sin, cos
    return R
