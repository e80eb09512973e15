"""Fit the hands of a held-out set to their depth, for scoring."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from handpose.data import labels
from handpose.depth_fit.fit import DepthFitter
from handpose.depth_fit.observation import HandCrops
from handpose.depth_fit.search import Plan
from handpose.prediction.crop_fits import MAX_CROPS, fit_crops
from handpose.prediction.nets import crops_of, data_layer, hand_layer, skeleton_to_fit
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.layer import TEST
from netlib.net import Net
from netlib.system.memory import blocks


def deploy_of(net: Net, model: str | Path, weights: str | Path, engine: str | None = None) -> Net:
    """The net of ``model``, which is the test net with an input. Raises NetlibError, also for that of another body."""
    deploy, hand = Net(model, TEST, engine=engine), hand_layer(net)
    own = skeleton_to_fit(deploy)
    if hand is not None and hand.skeleton.param != own.param:
        other = f"{hand.skeleton.name!r}" + (", with other numbers" if hand.skeleton.name == own.name else "")
        raise NetlibError(f"{deploy.source}: its body is {own.name!r}, that of {net.source} is {other}; "
                          "expected the same net with an input (--deploy)")  # fmt: skip
    deploy.copy_from(weights, strict=True)
    return deploy


def fit_all(
    net: Net, deploy: Net, weights: str | Path, plan: Plan, progress: Callable[[int], None] = lambda done: None
) -> Array:
    """Joints (N, K, 3) in half-cubes of every frame that the test net reads, fitted from the predictions of ``deploy``.

    weights  the weights file of both nets; it may contain the network's errors
    """
    data, skeleton = data_layer(net), skeleton_to_fit(deploy)
    half = np.concatenate([labels.read_half_cubes(file) for file in data.files])
    centers, camera = labels.read_crop_centers(data.files)
    joints = np.zeros((len(half), len(skeleton.joint_names), 3))
    done = 0
    for unit in np.unique(half):
        fitter = DepthFitter.of_file(skeleton, weights, float(unit))
        own = np.flatnonzero(half == unit)
        for rows in blocks(len(own), MAX_CROPS):
            crops = np.stack(crops_of(net, own[rows]))
            hands = HandCrops.of_sides(crops, centers[own[rows]], camera, 2 * float(unit))
            found = fit_crops(deploy, fitter, hands, plan)
            joints[own[rows]] = found.joints / unit
            done += len(crops)
            progress(done)
    return joints
