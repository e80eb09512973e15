"""Flesh drawn over the depth that it explains."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.drawing import hands
from handpose.drawing.strokes import Colour, Image
from handpose.facts.cameras import Camera
from handpose.flesh.render import Capsules, in_front, normalise_depth, render_crop

SKIN: Colour = (120, 165, 235)  # blue, green, red
MISSING: Colour = (90, 60, 200)
BACKGROUND = 0.999  # depths from it on are the far face: what is left of it by rounding, too
_LIGHT = np.array([-0.35, 0.45, -0.82])  # from the upper left, behind the viewer
_STEP = 0.08  # half-cubes: a larger step of depth from pixel to pixel is an edge, and has no slope


def over_crop(
    crop: NDArray[np.floating], capsules: Capsules, center_uvd: ArrayLike, cube_mm: float, camera: Camera, zoom: int = 4
) -> Image:
    """The flesh, shaded, on the crop (S, S) in [-1, 1]; reddish where nothing was seen behind it.

    capsules  of one body, in mm from the crop's centre
    """
    uvd = np.asarray(center_uvd, dtype=np.float64).reshape(1, 3)
    center = camera.unproject(uvd)
    moved = Capsules(capsules.a + center[:, None], capsules.b + center[:, None], capsules.radius_a, capsules.radius_b)
    near = in_front(moved, uvd[:, 2] - cube_mm / 2)  # what is nearer is not in the crop
    drawn = normalise_depth(render_crop(near, uvd, cube_mm, camera, len(crop)), uvd[:, 2], cube_mm)[0]
    canvas = hands.picture(crop, zoom)
    large = cv2.resize(drawn, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST)
    shown = large < BACKGROUND
    light = cv2.resize(_shade(drawn), None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
    seen = (crop < BACKGROUND).astype(np.uint8)
    behind = cv2.resize(seen, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST) > 0
    colour = np.where(behind[..., None], np.array(SKIN), np.array(MISSING)) * light[..., None]
    mixed = np.where(shown[..., None], 0.75 * colour + 0.25 * canvas, canvas)
    return np.asarray(np.clip(np.rint(mixed), 0, 255), np.uint8)


def _shade(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """How light each pixel of a surface is, 0 to 1."""
    pixel = 2 / len(depth)  # half-cubes
    across, down = np.gradient(depth, axis=1), np.gradient(depth, axis=0)
    for slope in (across, down):
        slope[np.abs(slope) > _STEP] = 0
    normal = np.stack([across / pixel, -down / pixel, -np.ones_like(depth)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = (normal * _LIGHT).sum(axis=-1) / np.linalg.norm(_LIGHT)
    return np.asarray(np.clip(0.35 + 0.65 * light, 0, 1), np.float32)
