"""The hand of one person from depth frames alone: which it is, how large, how thick."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.observation import observe
from handpose.depth_fit.search import PLANS
from handpose.depth_fit.size_calibration import HandSize, calibrate_size
from handpose.facts.sides import Side, is_mirrored
from handpose.prediction.many import fit_crops
from handpose.prediction.predictor import Predictor
from netlib.errors import DataError


def hand_of(
    predictor: Predictor,
    frames: Iterable[tuple[str, NDArray[np.generic]]],
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Side, HandSize]:
    """Right or left, as most frames say, and its size. Raises DataError, NetlibError.

    predictor  one that fits
    frames     names and depth images in mm, of one camera
    progress   is told of every frame found, and of every size that a frame was tried with
    """
    assert predictor.fitter is not None and predictor.fit != "no"
    found = []
    for name, depth in frames:
        try:
            found.append(predictor.in_frame(depth))
        except DataError as error:
            raise DataError(f"{name}: {error}") from None
        progress(1)
    side: Side = "left" if sum(frame.hand == "left" for frame in found) * 2 > len(found) else "right"
    camera = found[0].camera
    crops, uvd = np.stack([frame.crop for frame in found]), np.stack([frame.center_uvd for frame in found])
    fit = fit_crops(predictor.net, predictor.fitter, crops, uvd, camera, predictor.fit, side=side)
    seen = observe(crops, uvd, camera, predictor.cube_mm, PLANS["fast"].points)
    size = calibrate_size(predictor.fitter, seen.mirrored() if is_mirrored(side) else seen, fit.x, progress)
    return side, size
