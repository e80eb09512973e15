"""FastHandModel: FastKinematics with reused memory, and only positions if no gradient is needed."""

from __future__ import annotations

from fast.fast_layer import FastLayer
from fast.kinematics import FastKinematics
from layers.hand.hand_model import HandModel
from layers.hand.sized_hand_model import SizedHandModel
from netlib.blob import Blobs


class FastHandModel(FastLayer, HandModel):
    """Forward kinematics, batch last."""

    kinematics_type = FastKinematics
    kinematics: FastKinematics

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Positions; the pose only for backward."""
        body = self._body(bottom)
        y = top[0].data.reshape(len(body[0]), len(self.skeleton.joint_names), 3)
        if self.needs_backward:
            self.pose = self.kinematics.forward(*body)
            y[...] = self.pose.joints
            self.kinematics.spare = self.pose  # backward is done with it before the next forward
        else:
            y[...] = self.kinematics.joints(*body)


class FastSizedHandModel(FastHandModel, SizedHandModel):
    """The same of bodies of different sizes."""
