"""Draw a surface over the depth image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.capsules import Capsules, in_front
from handpose.body.render import render, shown_in_crop
from handpose.frames.cameras import Camera
from handpose.frames.crops import FAR_FACE
from handpose.output.drawing import hands
from handpose.output.drawing.strokes import Colour, Image
from netlib.blob import Array

SKIN_COLOUR: Colour = (120, 165, 235)  # blue, green, red
MISSING_COLOUR: Colour = (90, 60, 200)
_LIGHT_DIRECTION = np.array([-0.35, 0.45, -0.82])  # from the upper left, behind the viewer
_STEEP = 5.0  # maximum slope; a steeper one is an edge
_SAMPLES = 144  # maximum number of rendered pixels along the longer side of a hand's rectangle
_OBLIQUE = 1.3  # elongation of a sphere at the image's edge
_NOTHING = 1e5  # mm: depth of rays without a surface
_OPACITY = np.float32(0.5)  # of a surface on an image


def over_crop(
    crop: NDArray[np.floating],
    capsules: Capsules,
    center_uvd: ArrayLike,
    cube_mm: float,
    camera: Camera,
    zoom: int = 4,
) -> Image:
    """The shaded surface on the crop (S, S) in [-1, 1]; reddish where there is no depth behind it.

    capsules  of one body, in mm from the crop's centre
    """
    uvd = np.asarray(center_uvd, dtype=np.float64).reshape(3)
    in_camera = capsules.moved(camera.unproject(uvd))
    drawn = shown_in_crop(in_camera, uvd, cube_mm, camera, len(crop))
    canvas = hands.picture(crop, zoom)
    shown = hands.enlarged(drawn, zoom) < FAR_FACE
    light = hands.enlarged(_shade(drawn, 2 / len(drawn)), zoom, cv2.INTER_LINEAR)
    has_depth = hands.enlarged((crop < FAR_FACE).astype(np.uint8), zoom) > 0
    surface = np.where(has_depth[..., None], SKIN_COLOUR, MISSING_COLOUR) * light[..., None]
    mixed = np.where(shown[..., None], 0.75 * surface + 0.25 * canvas, canvas)
    return np.asarray(np.clip(np.rint(mixed), 0, 255), np.uint8)


def paint(canvas: Image, capsules: Capsules, camera: Camera) -> None:
    """The shaded surface on an image (height, width, 3) whose pixels are the camera's.

    capsules  of one body, in mm, camera axes
    """
    near = in_front(capsules)
    rows, columns = _rectangle(near, camera, canvas)
    part = canvas[rows, columns]
    if not part.size:
        return
    height, width = part.shape[:2]
    step = max(1.0, max(width, height) / _SAMPLES)
    x = (columns.start + _samples(width, step) - camera.u0) / camera.fx
    y = (rows.start + _samples(height, step) - camera.v0) / camera.fy
    depth = render(near, x[None], y[None], np.array([_NOTHING]))[0]
    light = _shade(depth, depth * np.float32(step / camera.fx))
    shaded = light[..., None] * np.array(SKIN_COLOUR, np.float32)
    skin = cv2.resize(shaded.astype(np.uint8), (width, height))
    shown = cv2.resize((depth < _NOTHING).astype(np.float32), (width, height))
    cover = cv2.blur(shown, (3, 3)) * _OPACITY  # blurred: smooth outlines
    part[...] = cv2.blendLinear(np.ascontiguousarray(part), skin, 1 - cover, cover)


def _samples(pixels: int, step: float) -> Array:
    """Sample positions along a number of pixels, as in cv2.resize, and their distance."""
    count = max(round(pixels / step), 1)
    return (np.arange(count) + 0.5) * pixels / count - 0.5


def _rectangle(capsules: Capsules, camera: Camera, canvas: Image) -> tuple[slice, slice]:
    """Rows and columns of an image that contain the capsules, with a margin."""
    ends = np.concatenate([capsules.a[0], capsules.b[0]])
    radii = np.append(capsules.radius_a[0], capsules.radius_b[0])
    seen = ends[:, 2] < _NOTHING
    if not seen.any():
        return slice(0), slice(0)
    ends, radii = ends[seen], radii[seen]
    at = camera.project(ends)[:, :2]
    slope = radii / (ends[:, 2] - radii)
    reach = (slope * max(camera.fx, camera.fy) * _OBLIQUE + 2)[:, None]
    size = canvas.shape[1], canvas.shape[0]
    left, top = np.clip((at - reach).min(axis=0), 0, size).astype(int).tolist()
    right, bottom = np.clip((at + reach).max(axis=0), 0, size).astype(int).tolist()
    return slice(top, bottom), slice(left, right)


def _shade(depth: NDArray[np.float32], pixel: float | NDArray[np.float32]) -> NDArray[np.float32]:
    """The lightness of each pixel of a surface, 0 to 1; pixels are ``pixel`` apart, in
    units of the depth.
    """
    across, down = (np.gradient(depth, axis=axis) / pixel for axis in (1, 0))
    for slope in (across, down):
        slope[np.abs(slope) > _STEEP] = 0
    lx, ly, lz = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
    length = np.sqrt(across * across + down * down + 1)
    light = (across * lx - down * ly - lz) / length
    return np.asarray(np.clip(0.35 + 0.65 * light, 0, 1), np.float32)
