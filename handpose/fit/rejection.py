"""Rejection score: how unlike a hand a place in an image is, in mm, to compare places after their fits.

The cost of a fit measures how far observed points are from the body. But a stick fits one limb of a hand whose
other limbs are missing, and the end of a table fits a hand that leaves the image. So the score is the sum of

    unexplained  mean difference in depth between image and rendered body, over all pixels that show either
    alone        the same over the pixels that show the body without its limbs: is the whole hand visible?
    moved        half the mean distance of the joints from the network's, which was trained on hands only
    outside      100 mm times the share of the joints outside the image, and of the missing visible area
    cost         7 mm times its logarithm
    size         100 mm times the logarithm by which the size is beyond two deviations of people's; 0 if it is known
    thickness    likewise of the thickness: other objects fit only with a stretched hand

No pixel's difference counts more than CAP_MM. The weights are rounded from a ranking by logistic regression on 90
scenes (``handpose.synthetic.scenes``, seed 100).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules, in_front, normalise_depth, render_crop
from handpose.fit.body import SIZE, THICKNESS, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.observation import BACKGROUND, HandCrops
from handpose.frames.cameras import Camera
from netlib.blob import Array

CAP_MM = 40.0
MIN_VISIBLE = 0.08  # minimum share of a crop that a hand fills; 10% of the hands fill less than 0.1
MOVED, OUTSIDE_MM, COST_MM, STRETCHED_MM = 0.5, 100.0, 7.0, 100.0
USUAL_SIZE, USUAL_THICKNESS = 0.228, 0.2  # two deviations of the logarithms, of the recipe `people`


def rejection_score(model: CapsuleModel, fit: DepthFit, hands: HandCrops, *, known_size: bool = False) -> Array:
    """The scores (N,) in mm of fits to the crops of N places; ``known_size`` if the fits had a given size."""
    crops, uvd, camera, mirror = hands.crops, hands.center_uvd, hands.camera, hands.mirror
    surface = model.capsules(fit.x, hands.center_mm).mirrored(mirror)
    capsules = in_front(surface, uvd[:, 2] - model.unit_mm)  # parts nearer to the camera are not in the crop
    limbs = model.surface.limbs
    hand = _rendered(capsules.chosen(~limbs), uvd, 2 * model.unit_mm, camera, crops.shape[1])
    whole = hand
    if limbs.any():
        arm = _rendered(capsules.chosen(limbs), uvd, 2 * model.unit_mm, camera, crops.shape[1])
        whole = np.minimum(hand, arm)
    apart = np.minimum(np.abs(whole - crops) * model.unit_mm, CAP_MM)
    shown = (hand < BACKGROUND) & (hand <= whole)
    moved = np.linalg.norm(fit.joints - fit.network, axis=2).mean(axis=1)
    moved = np.maximum(moved, np.nan_to_num(fit.signs[:, -1], posinf=0))  # ``follow``: from the network
    u, v, _ = np.moveaxis(camera.project((fit.joints + hands.center_mm[:, None]) * mirror[:, None]), -1, 0)
    outside = ((u < 0) | (u >= camera.width) | (v < 0) | (v >= camera.height)).mean(axis=1)
    known = crops > -BACKGROUND  # depth at the near face is only a bound
    unexplained = _mean(apart, known & ((crops < BACKGROUND) | (whole < BACKGROUND)))
    shown &= known
    few = 1 - np.minimum(shown.sum(axis=(1, 2)) / (MIN_VISIBLE * crops[0].size), 1)
    stretched = np.maximum(np.abs(fit.x[:, THICKNESS]) - USUAL_THICKNESS, 0)
    if not known_size:
        stretched = stretched + np.maximum(np.abs(fit.x[:, SIZE] - np.log(TYPICAL_SIZE)) - USUAL_SIZE, 0)
    return np.asarray(
        unexplained
        + _mean(apart, shown)
        + MOVED * moved
        + OUTSIDE_MM * (outside + few)
        + COST_MM * np.log(np.maximum(fit.cost, 1.0))
        + STRETCHED_MM * stretched
    )


def _rendered(capsules: Capsules, uvd: Array, cube_mm: float, camera: Camera, size: int) -> NDArray[np.float32]:
    return normalise_depth(render_crop(capsules, uvd, cube_mm, camera, size), uvd[:, 2], cube_mm)


def _mean(values: NDArray[np.floating], where: NDArray[np.bool_]) -> Array:
    """Means (N,) over the pixels ``where``; CAP_MM if there are none."""
    count = where.sum(axis=(1, 2))
    return np.where(count > 0, (values * where).sum(axis=(1, 2)) / np.maximum(count, 1), CAP_MM)
