"""FastHandModel: FastKinematics, its memory used again, and positions alone where nobody will ask for a gradient."""

from __future__ import annotations

from fast.kinematics import FastKinematics, FastPose
from fast.twin import Twin
from layers.hand.hand_model import HandModel
from netlib.blob import Blobs


class FastHandModel(Twin, HandModel):
    """Forward kinematics, batch last."""

    kinematics: FastKinematics

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Take the fast kinematics."""
        super().setup(bottom, top)
        self.kinematics = FastKinematics(self.skeleton, self.dtype)
        self._last: FastPose | None = None

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Positions; the pose only for backward."""
        x = bottom[0].data.reshape(-1, len(self.skeleton.dof_names))
        y = top[0].data.reshape(len(x), len(self.skeleton.joint_names), 3)
        if self.needs_backward:
            self.pose = self._last = self.kinematics.forward(x, reuse=self._last)
            y[...] = self.pose.joints
        else:
            y[...] = self.kinematics.joints(x)
