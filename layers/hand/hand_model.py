"""HandModel: joint angles → joint positions, so that every prediction is a possible hand (the paper's Sec. 3.2).

bottom[0]  x  (N, D)      inputs of the skeleton's DoFs: radians, and half-cubes for lengths (the hand: D = 47)
bottom[1]  b              optional: how large each body is; without it, as large as the skeleton. By its shape
              (N, 1)      a factor of all bones and of the initial values of translations, as in ``Skeleton.scaled``
              (N, K)      signed bone lengths (K > 1), in half-cubes; that of a joint without a bone is ignored
top[0]     y  (N, 3 K)    joints, x y z each, in half-cubes from the crop centre; x right, y up, z away (K = 31)

y  = forward kinematics of x                 kinematics.py has the mathematics of both directions
dx = its transposed Jacobian times dy        0 for fixed DoFs

With lengths b_k, bone k along the axis a_k:

db_k = a_k . sum of dy_j                     over joint k and all joints j that hang on it

With a factor b, bone k is b bone_k, and a DoF that drives a translation starts at b initial_d. It is as if its input
were x_d + (b - 1) initial_d, and also a fixed one has such an input and a gradient dx_d at it:

db = sum over k of bone_k db_k + sum over d of initial_d dx_d

Kept for backward: ``pose``, the joints and the axes of all motions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import load_for
from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class HandModelParameter:
    """The ``hand_model_param { ... }`` block."""

    skeleton: str = numbered(1, "")  # a skeleton file; by default the packaged NYU hand


class HandModel(Layer):
    """Forward kinematics of a skeleton."""

    kinematics_type: type[Kinematics] = Kinematics  # fast/ replaces it
    param_type = HandModelParameter
    param_name = "hand_model_param"
    bottoms, tops = (1, 2), (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.skeleton = load_for(self.param.skeleton, self.source)
        body = self.skeleton if len(bottom) == 1 else self.skeleton.with_free_slides()
        self.kinematics = self.kinematics_type(body, self.dtype)
        self.starts = body.initial * body.slides  # (D,) what a factor multiplies besides bones
        self.still = np.flatnonzero(self.skeleton.fixed & body.slides)  # which only a factor moves

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        N, D, K = bottom[0].num, len(self.skeleton.dof_names), len(self.skeleton.joint_names)
        if not bottom[0].shape or bottom[0].count != N * D:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, "
                            f"skeleton {self.skeleton.name!r} expects ({N}, {D})")  # fmt: skip
        for b in bottom[1:]:
            self.is_factor = math.prod(b.shape[1:]) == 1
            if b.shape[:1] != (N,) or math.prod(b.shape[1:]) not in (1, K):
                raise self.fail(f"bottom {self.spec.bottom[1]!r} has shape {b.shape}, expected ({N}, 1), a factor, or "
                                f"({N}, {K}), the bone lengths of skeleton {self.skeleton.name!r}")  # fmt: skip
        top[0].reshape(N, 3 * K)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.pose = self.kinematics.forward(*self._body(bottom))
        top[0].data[...] = self.pose.joints.reshape(top[0].shape)

    def _body(self, bottom: Blobs) -> tuple[Array, ...]:
        """What the kinematics is given: inputs (N, D) and, if they are not the skeleton's, bone lengths (N, K)."""
        sk = self.skeleton
        x = bottom[0].data.reshape(-1, len(sk.dof_names))
        if len(bottom) == 1:
            return (x,)
        x, b = np.where(sk.fixed, 0, x), bottom[1].data.reshape(len(x), -1 if len(x) else 1)
        if self.is_factor:
            return x + (b - 1) * self.starts, b * sk.bones
        return x, np.where(sk.bone_axes < 0, 0, b)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not any(propagate_down):
            return
        dX = top[0].diff.reshape(-1, len(self.skeleton.joint_names), 3)
        dx = self.kinematics.backward(self.pose, dX)
        if any(propagate_down[1:]):
            db = self.kinematics.backward_bones(self.pose, dX)
            if self.is_factor:
                db = db @ self.skeleton.bones + dx @ self.starts
            bottom[1].diff[...] = db.reshape(bottom[1].shape)
        if propagate_down[0]:
            dx[:, self.still] = 0
            bottom[0].diff[...] = dx.reshape(bottom[0].shape)
