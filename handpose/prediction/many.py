"""Many crops at once: what a net sees in them, fitted to their depth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.depth_fit.fit import DepthFit, DepthFitter
from handpose.depth_fit.observation import observe
from handpose.depth_fit.search import PLANS
from handpose.facts.cameras import Camera
from handpose.facts.sides import Side, as_right, is_mirrored
from handpose.prediction.starts import fit_starts
from netlib.net import Net
from netlib.system.memory import blocks

TOGETHER = 128  # crops that are worked on together


def fit_crops(
    net: Net,
    fitter: DepthFitter,
    crops: NDArray[np.floating],
    center_uvd: ArrayLike,
    camera: Camera,
    plan: str,
    *,
    side: Side = "right",
    size: float | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> DepthFit:
    """The net's prediction in crops (N, S, S) in [-1, 1], fitted to them. Raises NetlibError.

    center_uvd  (N, 3) px, px, mm: where they were cut, with cubes of twice the fitter's unit
    side        of the hands; left ones are seen, and answered, in a mirror, where they are right ones
    size        of the hand, if it is known
    progress    is told how many more crops are done
    """
    how, uvd = PLANS[plan], np.asarray(center_uvd, dtype=np.float64)
    found = []
    for rows in blocks(len(crops), TOGETHER):
        starts = fit_starts(net, fitter.model, as_right(crops[rows], side), how.quarters)
        seen = observe(crops[rows], uvd[rows], camera, 2 * fitter.model.unit_mm, how.points)
        found.append(fitter.fit(seen.mirrored() if is_mirrored(side) else seen, starts, plan, size=size))
        progress(len(seen))
    return DepthFit(**{name: np.concatenate([getattr(part, name) for part in found]) for name in vars(found[0])})
