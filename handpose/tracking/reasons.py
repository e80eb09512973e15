"""The reason why a hand is not found at its expected place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import crop, pixels_of
from handpose.depth_fit.observation import BACKGROUND
from handpose.facts.cameras import Camera
from handpose.track_files.track import HIDDEN, LEFT
from handpose.tracking.pose_estimator import Estimate, SearchRegion
from netlib.errors import DataError

NO_HAND = "the object at its last position does not look like a hand"
MIN_VISIBLE = 0.03  # minimum share of foreground in a crop
COVERED = 0.3  # share of a crop that is nearer than the cube: the hand is hidden
MARGIN = 0.15  # in cube edges: a hand whose middle is closer to the image's edge is leaving


def reason(
    depth: NDArray[np.float32], camera: Camera, cube_mm: float, region: SearchRegion, estimate: Estimate | None
) -> str:
    """The reason why the hand was not found in a search region.

    estimate  the best pose found for it
    """
    d = region.center_uvd[2]
    if not (depth > 0).any():
        return "no depth in this frame"
    if d <= 0:
        return LEFT
    beyond = _edges_beyond(camera, 2 * cube_mm * MARGIN, region)
    if beyond:
        return _left_at(beyond)
    try:
        shown = crop(depth, region.center_uvd, cube_mm, camera)
    except DataError:
        return LEFT
    if (shown <= -BACKGROUND).mean() > COVERED:
        return f"{HIDDEN} by a nearer object"
    if (np.abs(shown) < BACKGROUND).mean() < MIN_VISIBLE:
        return f"only background at its last position, {d:.0f} mm away"
    if estimate is None:
        return LEFT
    cut = [edge for edge in _edges_beyond(camera, cube_mm, region) if _reaches(edge, depth, camera, cube_mm, region)]
    if cut:  # such as a wrist whose hand is outside already
        return _left_at(cut)
    return f"{NO_HAND} (confidence {estimate.confidence:.0%})"


def _left_at(edges: list[str]) -> str:
    return f"{LEFT} at the {' '.join(edges)} edge"


def _edges_beyond(camera: Camera, cube_mm: float, region: SearchRegion) -> list[str]:
    """The edges of the image beyond which a part of the cube lies."""
    (left, right), (upper, lower) = pixels_of(region.center_uvd[None], cube_mm, camera)
    beyond = {"left": left < 0, "right": right > camera.width, "upper": upper < 0, "lower": lower > camera.height}
    return [edge for edge, is_beyond in beyond.items() if is_beyond]


def _reaches(edge: str, depth: NDArray[np.float32], camera: Camera, cube_mm: float, region: SearchRegion) -> bool:
    """True if the edge cuts an object in the cube."""
    columns, rows = (slice(max(int(first), 0), max(int(end), 0))
                     for (first,), (end,) in pixels_of(region.center_uvd[None], cube_mm, camera))  # fmt: skip
    line = {"left": depth[rows, 0], "right": depth[rows, -1], "upper": depth[0, columns], "lower": depth[-1, columns]}
    return bool(((line[edge] > 0) & (np.abs(line[edge] - region.center_uvd[2]) < cube_mm / 2)).any())
