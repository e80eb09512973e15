"""handpose/fit/observation.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.observation import HandCrops, observe
from handpose.frames.cameras import NYU
from handpose.frames.crops import crop_pixels
from tests.handpose.fit.conftest import Scene


def test_points_lie_on_the_surface(scene: Scene) -> None:
    """Every point projects to a pixel of the crop with the same depth, and its ray
    passes through it.
    """
    seen = scene.seen
    assert (seen.known == 1).all()
    points, rays = seen.points.swapaxes(1, 2), seen.rays.swapaxes(1, 2)
    xyz = points + seen.center[:, None]
    at = np.rint(crop_pixels(NYU.project(xyz), scene.center_uvd, 300.0)).astype(int)
    n = np.arange(len(xyz))[:, None]
    found = scene.crops[n, at[..., 1], at[..., 0]] * 150
    # rounding in the crop moves a few points by a pixel
    assert (np.abs(found - points[..., 2]) < 1e-2).mean() > 0.98
    assert_allclose(np.cross(xyz, rays), 0, atol=1e-2)
    assert_allclose(np.linalg.norm(rays, axis=2), 1, atol=1e-6)


def test_columns_and_rows(scene: Scene, rng: np.random.Generator) -> None:
    """``offset`` and ``factor`` map a point in space to its column and row in the crop, whose
    pixels begin at -0.5.
    """
    seen = scene.seen
    xyz = rng.uniform(-100, 100, (12, 7, 3)) + seen.center[:, None]
    x, y, z = np.moveaxis(xyz, -1, 0)
    found = [
        seen.offset[:, [axis]] + seen.factor[:, [axis]] * way / z for axis, way in enumerate((x, y))
    ]
    expected = crop_pixels(NYU.project(xyz), scene.center_uvd, 300.0)
    assert_allclose(np.stack(found, axis=-1), expected - 0.5, atol=0.001)


def test_outside_and_nearest() -> None:
    """``outside`` is in mm, negative inside a square plate; ``nearest`` is the smallest depth
    of nine pixels.
    """
    crop = np.ones((1, 128, 128), np.float32)
    crop[:, 40:80, 50:70] = 0.2
    crop[:, 60, 60] = 1  # a pixel without a reading
    seen = observe(HandCrops(crop, [[320, 240, 700]], NYU, 300.0), 400, 3.0)
    px = 300 / 128
    assert seen.outside[0, 60, 45] == pytest.approx(4.5 * px, rel=0.02)
    assert seen.outside[0, 45, 60] == pytest.approx(-5.5 * px, rel=0.02)
    assert seen.outside[0, 60, 60] < 0
    assert seen.nearest[0, 39, 49] == pytest.approx(30)
    assert seen.nearest[0, 38, 49] == 150
    cut = np.full((1, 128, 128), 0.2, np.float32)
    # the plate continues beyond the crop
    assert observe(HandCrops(cut, [[320, 240, 700]], NYU, 300.0), 400, 3.0).outside.max() < -60 * px


def test_small_and_empty_crops_have_fewer_points() -> None:
    """If there are fewer pixels than points, each is used once and the rest are unknown; an empty
    crop has none.
    """
    crop = np.ones((2, 128, 128), np.float32)
    crop[0, 60:65, 60:70] = 0
    seen = observe(HandCrops(crop, [[320, 240, 700]] * 2, NYU, 300.0), 80, 3.0)
    assert seen.known.sum(axis=1).tolist() == [50, 0]
    assert len(np.unique(seen.points[0, :, :50], axis=1).T) == 50
    assert (seen.points[1] == 0).all()


def test_points_have_the_weights_of_their_pixels() -> None:
    """Also those of some of the crops."""
    crop = np.ones((2, 128, 128), np.float32)
    crop[:, 60:65, 60:70] = 0
    weight = np.ones_like(crop)
    weight[0, 60] = 0.25
    hands = HandCrops(crop, np.array([[320, 240, 700]] * 2), NYU, 300.0, weight=weight)
    assert observe(hands, 80, 3.0).known.sum(axis=1).tolist() == [42.5, 50]
    assert observe(hands.take(slice(1)), 80, 3.0).known.sum(axis=1).tolist() == [42.5]


def test_pixels_outside_the_image_yield_no_points() -> None:
    crop = np.zeros((1, 128, 128), np.float32)
    seen = observe(HandCrops(crop, [[5, 240, 700]], NYU, 300.0), 400, 3.0)
    u = NYU.project(seen.points[0].T + seen.center[0])[:, 0]
    assert u.min() > -0.6


def test_thin_parts_have_more_points() -> None:
    """A finger gets more points per pixel than a palm."""
    crop = np.ones((1, 128, 128), np.float32)
    crop[0, 20:100, 20:26] = 0  # 80 x 6
    crop[0, 60:100, 50:100] = 0  # 40 x 50
    seen = observe(HandCrops(crop, [[320, 240, 700]], NYU, 300.0), 300, 3.0)
    thin = (seen.points[0, 0] < -60).mean()
    assert thin > 1.4 * 480 / 2480


def test_cameras_of_several_views_together(scene: Scene) -> None:
    """Crops of frames and of their mirror images are observed as each alone."""
    cameras = [NYU, NYU.mirrored()] * 6
    both = observe(HandCrops(scene.crops, scene.center_uvd, cameras, 300.0), 400, 3.0)
    for n, camera in enumerate(cameras[:2]):
        one = slice(n, n + 1)
        crops = HandCrops(scene.crops[one], scene.center_uvd[one], camera, 300.0)
        alone = observe(crops, 400, 3.0)
        for name, values in vars(both.take(slice(n, n + 1))).items():
            own = values[n : n + 1] if name in ("outside", "nearest") else values
            if name != "frame":
                assert_array_equal(own, getattr(alone, name), name)
    assert both.center[0, 0] != both.center[1, 0]


def test_some_frames_and_some_points(scene: Scene) -> None:
    """``take`` selects frames, also repeatedly; ``thinned`` keeps every third point."""
    few = scene.seen.take(np.array([3, 3, 1])).thinned(3)
    assert_array_equal(few.points[1], scene.seen.points[3, :, ::3])
    assert len(few) == 3
    assert few.frame.tolist() == [3, 3, 1]
    assert few.known.shape == (3, 134)
    assert few.outside is scene.seen.outside  # nothing large is copied
