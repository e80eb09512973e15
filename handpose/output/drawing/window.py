"""The part of the frames that pictures show: around the hands, moving slowly, so that a video does not jerk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from handpose.frames.cameras import Camera
from handpose.tracking.track import TrackedHand
from netlib.blob import Array

SECONDS = 0.5  # time constant of a move
MARGIN = 1.1  # of the crops of all hands
MAX_ZOOM = 5.0  # at least a fifth of the frame is shown


class View(NamedTuple):
    """A part of a frame in pixels; the pixel in column c covers c to c + 1. Parts have the frame's aspect ratio."""

    left: float
    top: float
    width: float
    height: float


class Window:
    """Follows the hands in the frames of one camera, in the order of time; without hands it is the whole frame."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._state: Array | None = None  # middle u, v and the logarithm of the width in frame widths
        self._time = 0.0

    def see(self, time: float, hands: Sequence[TrackedHand]) -> View:
        """The part to show at a time in s."""
        wanted = self._around(hands)
        part = 1.0 if self._state is None else 1 - np.exp(-max(time - self._time, 0.0) / SECONDS)
        self._state = wanted if self._state is None else self._state + part * (wanted - self._state)
        self._time = time
        frame = np.array([self._camera.width, self._camera.height], np.float64)
        size = frame * min(float(np.exp(self._state[2])), 1.0)
        corner = np.clip(self._state[:2] - size / 2, 0, frame - size)
        return View(float(corner[0]), float(corner[1]), float(size[0]), float(size[1]))

    def _around(self, hands: Sequence[TrackedHand]) -> Array:
        width, height = self._camera.width, self._camera.height
        if not hands:
            return np.array([width / 2, height / 2, 0.0])
        boxes = np.array([box_of(hand, self._camera) for hand in hands])
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        low, high = np.clip(low, 0, (width, height)), np.clip(high, 0, (width, height))
        part = MARGIN * float(((high - low) / (width, height)).max())
        return np.array([*(low + high) / 2, np.log(np.clip(part, 1 / MAX_ZOOM, 1))])


def box_of(hand: TrackedHand, camera: Camera) -> tuple[float, float, float, float]:
    """Left, top, right and bottom edge in pixels of the middle plane of a hand's crop."""
    u, v, d = hand.center_uvd
    across, down = camera.fx * hand.cube_mm / 2 / d, camera.fy * hand.cube_mm / 2 / d
    return u + 0.5 - across, v + 0.5 - down, u + 0.5 + across, v + 0.5 + down
