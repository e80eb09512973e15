"""Where fits to the depth start: at the hands that a net sees in crops, also in crops turned by quarters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.body import SIZE, FleshModel
from handpose.depth_fit.joint_starts import near_joints
from handpose.depth_fit.search import turned_back
from handpose.prediction.nets import hand_poses
from handpose.rounding import NETWORK_STEP, rounded
from netlib.blob import Array
from netlib.net import Net


def fit_starts(net: Net, model: FleshModel, crops: NDArray[np.floating], quarters: Sequence[int]) -> list[Array]:
    """Variables (N, V) of the bodies that the net sees in crops (N, S, S) turned counter-clockwise by each of the
    quarters, for the crops as they are. Raises NetlibError."""
    poses = hand_poses(net, np.concatenate([np.rot90(crops, quarter, (1, 2)) for quarter in quarters]))
    x = model.variables_of(rounded(poses.inputs, NETWORK_STEP))
    size = rounded(np.log(poses.size), NETWORK_STEP)
    x[:, SIZE] = np.clip(size, model.lower[SIZE], model.upper[SIZE])
    if poses.joints is not None:
        x = near_joints(model, x, rounded(poses.joints, NETWORK_STEP) * model.unit_mm)
    return [
        turned_back(model, rounded(own, NETWORK_STEP), quarter)
        for own, quarter in zip(np.split(x, len(quarters)), quarters)
    ]
