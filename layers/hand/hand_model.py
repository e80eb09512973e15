"""HandModel: joint angles → joint positions, so that every prediction is a possible hand (the paper's Sec. 3.2).

bottom[0]  x  (N, D)      inputs of the skeleton's DoFs: radians, and half-cubes for lengths (the hand: D = 47)
top[0]     y  (N, 3 K)    joints, x y z each, in half-cubes from the crop centre; x right, y up, z away (K = 31)

y  = forward kinematics of x                 kinematics.py has the mathematics of both directions
dx = its transposed Jacobian times dy        0 for fixed DoFs

Kept for backward: ``pose``, the joints and the axes of all motions.
"""

from __future__ import annotations

from dataclasses import dataclass

from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import load_for
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.schema import numbered


@dataclass(frozen=True)
class HandModelParameter:
    """The ``hand_model_param { ... }`` block."""

    skeleton: str = numbered(1, "")  # a skeleton file; by default the packaged NYU hand


class HandModel(Layer):
    """Forward kinematics of a skeleton."""

    kinematics_type: type[Kinematics] = Kinematics  # fast/ replaces it
    param_type = HandModelParameter
    param_name = "hand_model_param"
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.skeleton = load_for(self.param.skeleton, self.source)
        self.kinematics = self.kinematics_type(self.skeleton, self.dtype)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        N, D, K = bottom[0].shape[0], len(self.skeleton.dof_names), len(self.skeleton.joint_names)
        if bottom[0].count != N * D:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, "
                            f"skeleton {self.skeleton.name!r} expects ({N}, {D})")  # fmt: skip
        top[0].reshape(N, 3 * K)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = bottom[0].data, top[0].data
        self.pose = self.kinematics.forward(x.reshape(-1, len(self.skeleton.dof_names)))
        y[...] = self.pose.joints.reshape(y.shape)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            dX = top[0].diff.reshape(-1, len(self.skeleton.joint_names), 3)
            bottom[0].diff[...] = self.kinematics.backward(self.pose, dX).reshape(bottom[0].shape)
