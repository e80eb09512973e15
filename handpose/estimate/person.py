"""The side, size and thickness of one person's hand, from depth frames alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side
from handpose.estimate.estimator import fit_crops
from handpose.estimate.predictor import Predictor
from handpose.fit.observation import HandCrops
from handpose.fit.search import FAST
from handpose.fit.size_calibration import HandSize, calibrate_size
from netlib.errors import DataError


def hand_of(
    predictor: Predictor,
    frames: Iterable[tuple[str, NDArray[np.generic]]],
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Side, HandSize]:
    """The side of the hand by majority of the frames, and its size. Raises DataError, NetlibError.

    predictor  with a fit
    frames     names and depth images in mm, of one camera
    progress   called with the number of further frames found, then with the number of fits done
    """
    assert predictor.fitter is not None and predictor.plan is not None
    found = []
    for name, depth in frames:
        try:
            found.append(predictor.in_frame(depth))
        except DataError as error:
            raise DataError(f"{name}: {error}") from None
        progress(1)
    side: Side = "left" if sum(frame.hand == "left" for frame in found) * 2 > len(found) else "right"
    crops, uvd = np.stack([frame.crop for frame in found]), np.stack([frame.center_uvd for frame in found])
    hands = HandCrops.of_sides(crops, uvd, found[0].camera, predictor.cube_mm, side)
    fit = fit_crops(predictor.net, predictor.fitter, hands, predictor.plan)
    return side, calibrate_size(predictor.fitter, hands.observe(FAST.points), fit.x, progress)
