"""Hands in space, seen from the right of the camera; the shown cube moves only when a hand is about to leave it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handpose.frames.cameras import Camera
from handpose.output.drawing import hands, strokes, surface
from handpose.output.drawing.strokes import Colour, Image
from handpose.tracking.track import TrackedHand
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

MIN_EXTENT_MM = 200.0  # half the edge of the displayed cube
MARGIN_MM = 40.0  # minimum distance of hands from its faces
SQUARE_MM = 100.0  # of a square of the floor
FOLLOW_S, SHRINK_S = 0.3, 4.0  # time constants of moving and growing, and of shrinking
DISTANCE = 7.0  # distance of the viewer in half edges: a weak perspective
_PAPER = 248
_SHADOW: Colour = (212, 212, 212)
_GRID: Colour = (222, 222, 222)
_INK: Colour = (110, 110, 110)
_VIEW = hands.viewer_from_world(35, 20)


class Space:
    """A cube in the camera's axes that holds all hands, with a floor of squares of 100 mm that do not move."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self._middle: Array | None = None  # mm
        self._half = MIN_EXTENT_MM
        self._time = 0.0

    def see(self, time: float, points: Array) -> None:
        """Move and grow the cube until it holds points (n, 3) in mm; ``time`` in s limits the speed."""
        if not len(points):
            return
        low, high = points.min(axis=0) - MARGIN_MM, points.max(axis=0) + MARGIN_MM
        needed = max(float((high - low).max()) / 2, MIN_EXTENT_MM)
        if self._middle is None:
            self._middle, self._half = (low + high) / 2, needed
        passed = max(time - self._time, 0.0)
        self._half += (needed - self._half) * _part(passed, FOLLOW_S if needed > self._half else SHRINK_S)
        out = np.minimum(low - (self._middle - self._half), 0) + np.maximum(high - (self._middle + self._half), 0)
        self._middle = self._middle + out * _part(passed, FOLLOW_S)
        self._time = time

    def picture(self, tracked: Sequence[TrackedHand], width: int, height: int) -> Image:
        """The cube from the right of the camera and from above, (height, width, 3)."""
        canvas = np.full((height, width, 3), _PAPER, dtype=np.uint8)
        if self._middle is None:
            return canvas
        scale = min(width, height) * 0.32 * DISTANCE
        camera = Camera("viewer", scale, scale, 0.5 * width, 0.44 * height, width, height)
        self._floor(canvas, camera)
        floor = self._middle[1] - self._half
        for hand in tracked:
            shadow = hand.xyz * (1, 0, 1) + (0, floor, 0)
            at = camera.project(self._seen(shadow))
            hands.draw(canvas, at[:, :2], hand.xyz[:, 1], self._skeleton, 3, _SHADOW, rim=False)
        for hand in sorted(tracked, key=lambda one: -float(self._seen(one.xyz)[:, 2].mean())):
            if hand.capsules is not None:
                surface.paint(
                    canvas,
                    hand.capsules._replace(a=self._seen(hand.capsules.a), b=self._seen(hand.capsules.b)),
                    camera,
                    opacity=0.45,
                )
            at = camera.project(self._seen(hand.xyz))
            guesses = hands.guessed(hand.finger_error_mm)
            hands.draw(canvas, at[:, :2], at[:, 2], self._skeleton, thick=2, guesses=guesses)
        return canvas

    def _seen(self, points: Array) -> Array:
        """Points (..., 3) in mm from the camera's axes to the viewer's."""
        return np.asarray((points - self._middle) @ _VIEW.T + (0, 0, DISTANCE * self._half))

    def _floor(self, canvas: Image, camera: Camera) -> None:
        """Lines fixed in the world, and the directions of x, y and z."""
        assert self._middle is not None
        low, high = self._middle - self._half, self._middle + self._half
        x, z = (np.arange(np.ceil(low[i] / SQUARE_MM), high[i] / SQUARE_MM) * SQUARE_MM for i in (0, 2))
        lines = [((at, low[1], low[2]), (at, low[1], high[2])) for at in [low[0], *x, high[0]]]
        lines += [((low[0], low[1], at), (high[0], low[1], at)) for at in [low[2], *z, high[2]]]
        for start, stop in camera.project(self._seen(np.array(lines)))[..., :2]:
            strokes.line(canvas, start, stop, _GRID, 1)
        for axis, name in enumerate("xyz"):
            tip = low + np.eye(3)[axis] * 0.35 * self._half
            start, stop = camera.project(self._seen(np.array([low, tip])))[:, :2]
            strokes.line(canvas, start, stop, _INK, 2)
            beyond = stop + (stop - start) / np.linalg.norm(stop - start) * 10 + (-4, 4)
            strokes.text(canvas, name, beyond, _INK, 0.5)


def _part(passed: float, seconds: float) -> float:
    """The fraction of a change after a time."""
    return 1 - float(np.exp(-passed / seconds))
