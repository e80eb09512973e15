"""Crops of right hands in whole scenes: with what is behind them, in front of them and held, and
with other hands and bodies.

A crop shows what the rays of a camera's pixels meet there (``scenes.sight``), with the errors of
whole frames, and is cleared as crops of recordings are (``handpose.frames.crops.clear_crop``).
Errors have the size of a camera's pixels, which are larger than those of the crop if the hand is
far away: then fingers merge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import crop_rays
from handpose.frames.cameras import Camera, Floats
from handpose.frames.crops import (
    BACKGROUND,
    SIZE,
    Window,
    normalise_joints,
    window,
    without_flying_pixels,
    without_isolated_near,
)
from handpose.synthetic.frame_errors import measure_fine
from handpose.synthetic.pose_prior import Bodies, BodySampler
from handpose.synthetic.scenes.cameras import draw_cameras
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.hands import Hands
from handpose.synthetic.scenes.people import RIGHT, draw_people
from handpose.synthetic.scenes.prior import ScenePrior
from handpose.synthetic.scenes.sight import Sight, sight_of
from netlib.blob import Array

SCENES = 16  # drawn together, so that their arrays stay in the cache
# A crop is taken if as much of its hand is seen, read of what is seen, and in the image.
MIN_SEEN, MIN_READ, MIN_JOINTS = 0.4, 0.5, 0.8
MIN_PX = 300  # of a hand that is seen
NEAREST_MM = 210.0  # of crop centres


class SceneCrops(NamedTuple):
    """N crops and their hands.

    bodies      half-cubes from the crop centres; inputs of the root are NaN, because the scene
                turns and moves its hands
    center_uvd  (N, 3) crop centres: px, px, mm
    depth       (N, 128, 128) in [-1, 1]
    """

    bodies: Bodies
    center_uvd: Array
    depth: Floats


def draw_scene_crops(
    rng: np.random.Generator, prior: ScenePrior, sampler: BodySampler, camera: Camera, count: int
) -> SceneCrops:
    """``count`` crops of a camera's frames."""
    parts, drawn = [], 0
    while drawn < count:
        part = _drawn(rng, prior, sampler, camera)
        parts.append(part)
        drawn += len(part.depth)
    bodies = (np.concatenate(values)[:count] for values in zip(*(part.bodies for part in parts)))
    center_uvd = np.concatenate([part.center_uvd for part in parts])
    depth = np.concatenate([part.depth for part in parts])
    return SceneCrops(Bodies(*bodies), center_uvd[:count], depth[:count])


def _drawn(
    rng: np.random.Generator, prior: ScenePrior, sampler: BodySampler, camera: Camera
) -> SceneCrops:
    """The crops of some scenes in which enough of the first hand is seen."""
    cube_mm = sampler.cube_mm
    draw = Draw(rng, SCENES)
    views = draw_cameras(draw, prior.view)
    people = draw_people(draw, prior, sampler, views, (RIGHT,))
    hands = people.hands[0]
    center_uvd = _centers(hands, camera)
    sight = sight_of(draw, prior, people, crop_rays(center_uvd, cube_mm, camera))
    pixels = window(center_uvd, cube_mm, camera)
    candidates = _in_image(hands, camera) & (sight.share[:, 0] > MIN_SEEN)
    rows, crops = [], []
    for n in np.flatnonzero(candidates & (hands.crop[:, 2] > NEAREST_MM)):
        depth = _measured(rng, sight, n, SIZE * center_uvd[n, 2] / cube_mm, pixels)
        own = sight.which[n] == 1
        if own.sum() >= MIN_PX and (depth[own] > 0).mean() >= MIN_READ:
            rows.append(n)
            crops.append(_cleared(depth, float(center_uvd[n, 2]), cube_mm, camera))
    inputs = hands.bodies.inputs.copy()
    inputs[:, [*sampler.rotation, *sampler.translation]] = np.nan
    joints = normalise_joints(hands.joints, camera.unproject(center_uvd), cube_mm / 2)
    bodies = hands.bodies._replace(inputs=inputs, joints=joints)
    depth = np.array(crops, np.float32).reshape(-1, SIZE, SIZE)
    return SceneCrops(Bodies(*(values[rows] for values in bodies)), center_uvd[rows], depth)


def _centers(hands: Hands, camera: Camera) -> Array:
    """The crop centres (N, 3), exact in float32, as the labels store them."""
    centers = hands.crop.copy()
    centers[:, 2] = np.maximum(centers[:, 2], NEAREST_MM)
    uvd = camera.project(centers)
    return uvd.astype(np.float32).astype(np.float64)


def _in_image(hands: Hands, camera: Camera) -> NDArray[np.bool_]:
    """Whether the crop centre and enough joints (N,) are in the image of a camera."""
    points = np.concatenate([hands.crop[:, None], hands.joints], axis=1)
    u, v, d = np.moveaxis(camera.project(points), -1, 0)
    is_inside = (u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)
    is_far_enough = d.min(axis=1) > camera.min_range_mm / 2
    return is_inside[:, 0] & is_far_enough & (is_inside[:, 1:].mean(axis=1) > MIN_JOINTS)


def _measured(
    rng: np.random.Generator, sight: Sight, n: np.intp, focal: float, pixels: Window
) -> Floats:
    """Readings (S, S) in mm of a crop, 0 where there is none or no image.

    focal  focal length in pixels of the crop
    """
    hand = sight.which[n] > 0
    depth = measure_fine(rng, sight.depth[n], hand, focal, sight.reflects[n])
    depth[:, pixels.columns[n] < 0] = 0
    depth[pixels.rows[n] < 0] = 0
    return depth


def _cleared(depth: Floats, d: float, cube_mm: float, camera: Camera) -> Floats:
    """A crop (S, S) in [-1, 1] about depth ``d`` of readings in mm, as ``clear_crop`` gives it."""
    half = cube_mm / 2
    is_read = (depth > 0) & ~camera.is_too_near(depth)
    crop = np.where(is_read, np.clip((depth - d) / half, -1, 1), BACKGROUND).astype(np.float32)
    return without_isolated_near(without_flying_pixels(crop, half, d / camera.fx), half)
