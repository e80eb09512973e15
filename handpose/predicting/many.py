"""Many crops at once: what a net sees in them, fitted to their depth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.facts.cameras import Camera
from handpose.fitting.depth.fit import DepthFit, DepthFitter
from handpose.fitting.depth.observation import observe
from handpose.fitting.depth.search import PLANS
from handpose.predicting.nets import turned_inputs
from netlib.net import Net
from netlib.rows import blocks

TOGETHER = 128  # crops that are worked on together


def fit_crops(
    net: Net,
    fitter: DepthFitter,
    crops: NDArray[np.floating],
    center_uvd: ArrayLike,
    camera: Camera,
    plan: str,
    *,
    left: bool = False,
    size: float | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> DepthFit:
    """The net's prediction in crops (N, S, S) in [-1, 1], fitted to them. Raises NetlibError.

    center_uvd  (N, 3) px, px, mm: where they were cut, with cubes of twice the fitter's unit
    left        see them, and answer, in a mirror, where a left hand is a right one
    size        of the hand, if it is known
    progress    is told how many more crops are done
    """
    how, uvd = PLANS[plan], np.asarray(center_uvd, dtype=np.float64)
    found = []
    for rows in blocks(len(crops), TOGETHER):
        some = crops[rows, :, ::-1] if left else crops[rows]
        predictions = turned_inputs(net, some, how.quarters)
        seen = observe(crops[rows], uvd[rows], camera, 2 * fitter.model.unit_mm, how.points)
        found.append(fitter.fit(seen.mirrored() if left else seen, predictions, plan, size=size))
        progress(len(some))
    return DepthFit(**{name: np.concatenate([getattr(part, name) for part in found]) for name in vars(found[0])})
