"""SizedHandModel: a HandModel with a second bottom that gives the size of each body.

bottom[0]  x  (N, D)      values of the skeleton's DoFs, as in hand_model.py
bottom[1]  b              size of each body; its shape selects one of
              (N, 1)      a factor of all bones and of the initial values of translations, as in
                          ``Skeleton.scaled``
              (N, K)      signed bone lengths (K > 1) in half-cubes; ignored for joints
                          without a bone
top[0]     y  (N, 3 K)    joints, as in hand_model.py

With lengths b_k, bone k along the axis a_k:

db_k = a_k . sum of dy_j                     over joint k and its descendants j

With a factor b, the length of bone k is b bone_k, and a DoF of a translation starts at b initial_d.
This is equivalent to the input x_d + (b - 1) initial_d, where fixed DoFs have an input and a
gradient dx_d too:

db = sum over k of bone_k db_k + sum over d of initial_d dx_d
"""

from __future__ import annotations

import math

import numpy as np

from layers.hand.hand_model import HandModel
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, Blobs


class SizedHandModel(HandModel):
    """Forward kinematics of skeletons of different sizes."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        super().setup(bottom, top)
        body = self._moving_body()
        self.starts = body.initial * body.slides  # (D,) initial translations, which a factor scales
        # fixed, so moved only by the factor
        self.still = np.flatnonzero(self.skeleton.fixed & body.slides)

    def _moving_body(self) -> Skeleton:
        return self.skeleton.with_free_slides()

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        super().reshape(bottom, top)
        (N, *_), K, b = top[0].shape, len(self.skeleton.joint_names), bottom[1]
        self.is_factor = math.prod(b.shape[1:]) == 1
        if b.shape[:1] != (N,) or math.prod(b.shape[1:]) not in (1, K):
            name = self.spec.bottom[1]
            raise self.fail(
                f"bottom {name!r} has shape {b.shape}, expected ({N}, 1), a factor, or "
                f"({N}, {K}), the bone lengths of skeleton {self.skeleton.name!r}"
            )

    def _body(self, bottom: Blobs) -> tuple[Array, ...]:
        [x], sk = super()._body(bottom), self.skeleton
        x = np.where(sk.fixed, 0, x)
        b = bottom[1].data.reshape(len(x), -1 if len(x) else 1)
        if self.is_factor:
            return x + (b - 1) * self.starts, b * sk.bones
        return x, np.where(sk.bone_axes < 0, 0, b)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not any(propagate_down):
            return
        dX = top[0].diff.reshape(-1, len(self.skeleton.joint_names), 3)
        dx = self.kinematics.backward(self.pose, dX)
        if propagate_down[1]:
            db = self.kinematics.backward_bones(self.pose, dX)
            if self.is_factor:
                db = db @ self.skeleton.bones + dx @ self.starts
            bottom[1].diff[...] = db.reshape(bottom[1].shape)
        if propagate_down[0]:
            dx[:, self.still] = 0
            bottom[0].diff[...] = dx.reshape(bottom[0].shape)
