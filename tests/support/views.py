"""Depth frames as the estimators take them."""

from __future__ import annotations

import numpy as np

from handpose.body.sides import SideView
from handpose.frames.cameras import Camera


def frame_of(depth: np.ndarray, camera: Camera, readings: np.ndarray | None = None) -> SideView:
    """A frame as the camera sees it."""
    return SideView("right", camera, depth, depth if readings is None else readings)
