"""How little a place in a picture is a hand, in mm: what compares places that were all predicted and fitted.

The misfit of a fit asks where what was seen lies on the body. But a stick lies well on one limb of a hand whose rest
is nowhere, and the end of a table on one that leaves the picture. So these are added:

    unexplained  mean difference of depth between picture and rendered body, over all pixels that show either
    alone        the same over the pixels that show the body without its limbs: is all of the hand there?
    moved        half the mean distance of the joints from where the network had them: it has seen hands, nothing else
    outside      100 mm times the share of the joints that are outside the image, and of what is too little to see
    misfit       7 mm times its logarithm
    size, girth  100 mm times the absolute logarithm of each: what is no hand becomes one only when it is stretched

No pixel's difference counts more than CAP_MM. The weights are those of a ranking by logistic regression, rounded, on 90
scenes drawn for it (``handpose.synthetic.scenes``, seed 100).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.body import GIRTH, SIZE, FleshModel
from handpose.depth_fit.fit import DepthFit
from handpose.depth_fit.observation import BACKGROUND, HandCrops
from handpose.facts.cameras import Camera
from handpose.surface.render import Capsules, in_front, normalise_depth, render_crop
from netlib.blob import Array

CAP_MM = 40.0
FEWEST = 0.08  # part of a crop that a hand fills at least: 10% of them fill less than 0.1
MOVED, OUTSIDE_MM, MISFIT_MM, STRETCHED_MM = 0.5, 100.0, 7.0, 100.0


def rejection_score(model: FleshModel, fit: DepthFit, hands: HandCrops) -> Array:
    """The scores (N,) in mm of fits to the crops of N places."""
    crops, uvd, camera, mirror = hands.crops, hands.center_uvd, hands.camera, hands.mirror
    flesh = model.capsules(fit.x, hands.center_mm).mirrored(mirror)
    capsules = in_front(flesh, uvd[:, 2] - model.unit_mm)  # nearer is not in the crop
    whole = _rendered(capsules, uvd, 2 * model.unit_mm, camera, crops.shape[1])
    own = ~model.flesh.limbs
    hand = _rendered(capsules.chosen(own), uvd, 2 * model.unit_mm, camera, crops.shape[1])
    apart = np.minimum(np.abs(whole - crops) * model.unit_mm, CAP_MM)
    shown = (hand < BACKGROUND) & (hand <= whole)
    moved = np.linalg.norm(fit.joints - fit.network, axis=2).mean(axis=1)
    moved = np.maximum(moved, np.nan_to_num(fit.signs[:, -1], posinf=0))  # of a fit that follows, as the network said
    u, v, _ = np.moveaxis(camera.project((fit.joints + hands.center_mm[:, None]) * mirror[:, None]), -1, 0)
    outside = ((u < 0) | (u >= camera.width) | (v < 0) | (v >= camera.height)).mean(axis=1)
    told = crops > -BACKGROUND  # at the near face anything may be
    unexplained = _mean(apart, told & ((crops < BACKGROUND) | (whole < BACKGROUND)))
    shown &= told
    few = 1 - np.minimum(shown.sum(axis=(1, 2)) / (FEWEST * crops[0].size), 1)
    stretched = np.abs(fit.x[:, [SIZE, GIRTH]]).sum(axis=1)
    return np.asarray(
        unexplained
        + _mean(apart, shown)
        + MOVED * moved
        + OUTSIDE_MM * (outside + few)
        + MISFIT_MM * np.log(np.maximum(fit.misfit, 1.0))
        + STRETCHED_MM * stretched
    )


def _rendered(capsules: Capsules, uvd: Array, cube_mm: float, camera: Camera, size: int) -> NDArray[np.float32]:
    return normalise_depth(render_crop(capsules, uvd, cube_mm, camera, size), uvd[:, 2], cube_mm)


def _mean(values: NDArray[np.floating], where: NDArray[np.bool_]) -> Array:
    """Means (N,) of the pixels chosen; all of CAP_MM where there are none."""
    count = where.sum(axis=(1, 2))
    return np.where(count > 0, (values * where).sum(axis=(1, 2)) / np.maximum(count, 1), CAP_MM)
