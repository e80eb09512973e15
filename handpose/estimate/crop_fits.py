"""Predict hands in crops and fit them to the depth, many together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.estimate.nets import hand_poses
from handpose.fit.body import SIZE_INDEX
from handpose.fit.depth_fit import DepthFit, DepthFitter
from handpose.fit.joint_starts import near_joints
from handpose.fit.observation import HandCrops
from handpose.fit.rounding import NETWORK_STEP, rounded
from handpose.fit.search import turned_back
from handpose.fit.settings import Plan
from netlib.blob import Array, blocks
from netlib.net import Net

MAX_CROPS = 128  # number of crops in one pass of the network


def fit_crops(
    net: Net,
    fitter: DepthFitter,
    hands: HandCrops,
    plan: Plan,
    *,
    size: float | Array | None = None,
    before: Array | None = None,
) -> DepthFit:
    """Predict the hands in crops and fit them to the depth. Raises NetlibError.

    hands     with cubes of twice the fitter's unit
    size      of the hands relative to the skeleton, one or (N,), if it is known
    before    x (N, V) expected from earlier frames, as for ``DepthFitter.fit``
    """
    found = []
    sizes = None if size is None else np.broadcast_to(size, len(hands))
    for rows in blocks(len(hands), MAX_CROPS):
        part = hands.take(rows)
        starts = fit_starts(net, fitter, part.network_input, plan.quarters)
        seen = fitter.observe(part, plan)
        own_sizes = None if sizes is None else sizes[rows]
        expected = None if before is None else before[rows]
        found.append(fitter.fit(seen, starts, plan, size=own_sizes, before=expected))
    return DepthFit.concatenate(found)


def fit_starts(
    net: Net, fitter: DepthFitter, crops: NDArray[np.floating], quarters: Sequence[int]
) -> list[Array]:
    """The variables (N, V) predicted in crops (N, S, S) of right hands, one array per quarter turn.

    For each of ``quarters`` the crops are turned counter-clockwise by that number of quarter turns,
    and predictions are turned back. Raises NetlibError.
    """
    poses = hand_poses(
        net, np.concatenate([np.rot90(crops, quarter, (1, 2)) for quarter in quarters])
    )
    model = fitter.model
    x = model.variables_of(rounded(poses.inputs, NETWORK_STEP))
    size = rounded(np.log(poses.size), NETWORK_STEP)
    x[:, SIZE_INDEX] = np.clip(size, model.lower[SIZE_INDEX], model.upper[SIZE_INDEX])
    if poses.joints is not None:
        joints = rounded(poses.joints, NETWORK_STEP) * model.unit_mm
        x = near_joints(model, x, joints, fitter.settings.joint_starts)
    return [
        turned_back(model, rounded(turned, NETWORK_STEP), quarter)
        for turned, quarter in zip(np.split(x, len(quarters)), quarters)
    ]
