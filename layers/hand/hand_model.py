"""HandModel: joint angles → joint positions, so that every prediction is a valid hand
(Sec. 3.2 of the paper).

bottom[0]  x  (N, D)      values of the skeleton's DoFs: radians, or half-cubes for lengths
                          (the hand: D = 47)
top[0]     y  (N, 3 K)    x y z of each joint, in half-cubes from the crop centre; x right, y up,
                          z away (K = 31)

y  = forward kinematics of x                 derived in kinematics.py
dx = transposed Jacobian times dy            0 for fixed DoFs

With a second bottom, the size of each body, the layer is a SizedHandModel (sized_hand_model.py).

Kept for backward: ``pose``, the joints and the axes of all motions.
"""

from __future__ import annotations

from dataclasses import dataclass

from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton, load_for
from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class HandModelParameter:
    """The ``hand_model_param { ... }`` block."""

    skeleton: str = numbered(1, "")  # path of a skeleton file; default is the packaged NYU hand


class HandModel(Layer):
    """Forward kinematics of a skeleton."""

    kinematics_type: type[Kinematics] = Kinematics  # replaced in fast/
    param: HandModelParameter
    param_name = "hand_model_param"
    bottoms, tops = (1, 2), (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.skeleton = load_for(self.param.skeleton, self.source)
        self.kinematics = self.kinematics_type(self._moving_body(), self.dtype)

    def _moving_body(self) -> Skeleton:
        """The skeleton with the DoFs that can move."""
        return self.skeleton

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        N, D, K = bottom[0].num, len(self.skeleton.dof_names), len(self.skeleton.joint_names)
        if not bottom[0].shape or bottom[0].count != N * D:
            name = self.spec.bottom[0]
            raise self.fail(
                f"bottom {name!r} has shape {bottom[0].shape}, "
                f"skeleton {self.skeleton.name!r} expects ({N}, {D})"
            )
        top[0].reshape(N, 3 * K)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.pose = self.kinematics.forward(*self._body(bottom))
        top[0].data[...] = self.pose.joints.reshape(top[0].shape)

    def _body(self, bottom: Blobs) -> tuple[Array, ...]:
        """Arguments of the kinematics: inputs (N, D) and, if they differ from the skeleton's, bone
        lengths (N, K).
        """
        return (bottom[0].data.reshape(-1, len(self.skeleton.dof_names)),)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            dX = top[0].diff.reshape(-1, len(self.skeleton.joint_names), 3)
            bottom[0].diff[...] = self.kinematics.backward(self.pose, dX).reshape(bottom[0].shape)
