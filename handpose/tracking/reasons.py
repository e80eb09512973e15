"""Why a hand is not found where it should be, in one line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import crop
from handpose.facts.cameras import Camera
from handpose.fitting.depth.observation import BACKGROUND
from handpose.tracking.looking import Aim, Sight
from handpose.tracks.reasons import HIDDEN, LEFT
from netlib.errors import DataError

NO_HAND = "what is seen where it was does not look like a hand"
FEWEST = 0.03  # part of a crop that shows something
COVERED = 0.3  # part of a crop that is nearer than the cube around the hand
MARGIN = 0.15  # of the cube around the hand: if its middle is so near the image's edge, the hand leaves it


def reason(depth: NDArray[np.float32], camera: Camera, cube_mm: float, aim: Aim, sight: Sight | None) -> str:
    """What became of the hand that was expected at an aim.

    sight  the best that was seen of it
    """
    u, v, d = aim.center_uvd
    if not (depth > 0).any():
        return "nothing was read in this frame"
    if d <= 0:
        return LEFT
    across, down = (MARGIN * cube_mm * f / d for f in (camera.fx, camera.fy))
    sides = [
        name
        for name, beyond in (
            ("left", u < across),
            ("right", u > camera.width - across),
            ("upper", v < down),
            ("lower", v > camera.height - down),
        )
        if beyond
    ]
    if sides:
        return f"{LEFT} at the {' '.join(sides)} edge"
    try:
        shown = crop(depth, aim.center_uvd, cube_mm, camera)
    except DataError:
        return LEFT
    if (shown <= -BACKGROUND).mean() > COVERED:
        return f"{HIDDEN} by something nearer"
    if (np.abs(shown) < BACKGROUND).mean() < FEWEST:
        return f"nothing is seen where it was, {d:.0f} mm away"
    if sight is None:
        return LEFT
    return f"{NO_HAND} (confidence {sight.confidence:.0%})"
