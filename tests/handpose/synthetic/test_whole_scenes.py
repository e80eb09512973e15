"""handpose/synthetic/whole_scenes.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.render import render
from handpose.synthetic import whole_scenes
from handpose.synthetic.whole_scenes import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    HAND,
    HEIGHT,
    WIDTH,
    SceneGenerator,
    Scenes,
)


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    return SceneGenerator(7).block(3)


def test_a_block_depends_on_seed_split_and_number_alone(scenes: Scenes) -> None:
    generator = SceneGenerator(7)
    generator.block(0)
    for own, again in zip(scenes, generator.block(3), strict=True):
        np.testing.assert_array_equal(own, again)
    assert not np.array_equal(scenes.depth, SceneGenerator(7, "test").block(3).depth)


def test_the_labels_agree_with_each_other(scenes: Scenes) -> None:
    """Hands and pixels; the pixels of hands lie within a hand's length of the palm."""
    np.testing.assert_array_equal(scenes.classes == HAND, scenes.which > 0)
    assert not (scenes.present & scenes.doubtful).any() and scenes.present.sum() > 8
    for n, k in np.argwhere(scenes.present):
        column, row = scenes.middle_px[n, k]
        assert 0 < column < WIDTH and 0 < row < HEIGHT
        pixels = (scenes.which[n] == k + 1) & (scenes.depth[n] > 0)
        points = (
            np.concatenate([scenes.slopes[n], np.ones((HEIGHT, WIDTH, 1))], axis=-1)
            * scenes.depth[n][..., None]
        )
        apart = np.linalg.norm(points[pixels] - scenes.middle[n, k], axis=1)
        assert np.median(apart) < 130


@pytest.mark.parametrize("kind", [BOX, CYLINDER, ELLIPSOID])
def test_solids_agree_with_steps_along_the_rays(kind: int) -> None:
    """The first of many points on a ray that lies in the solid."""
    rng = np.random.default_rng(kind)
    axes = whole_scenes._rotations(rng)
    center, half = np.array([20.0, -10.0, 500.0]), np.array([60.0, 40.0, 60.0])
    x = np.linspace(-0.2, 0.2, 9, dtype=np.float32)
    entry = whole_scenes._entry(kind, center, axes, half, x, x)
    steps = np.arange(350.0, 650.0, 0.25)
    rays = np.stack(np.broadcast_arrays(x[None, :], -x[:, None], np.float32(1)), axis=-1)
    local = np.abs((steps[:, None] * rays[..., None, :] - center) @ axes / half)
    size = {
        BOX: local.max(axis=-1),
        ELLIPSOID: np.linalg.norm(local, axis=-1),
        CYLINDER: np.maximum(local[..., 1], np.hypot(local[..., 0], local[..., 2])),
    }[kind]
    hit, missed = (size <= 1).sum(axis=-1) > 8, size.min(axis=-1) > 1.01
    np.testing.assert_allclose(entry[hit], steps[(size <= 1).argmax(axis=-1)][hit], atol=0.5)
    assert np.isinf(entry[missed]).all() and hit.sum() > 10


def test_left_hands_are_mirrored_right_hands() -> None:
    sampler = SceneGenerator().sampler
    right, left = (
        whole_scenes._draw_hands(np.random.default_rng(5), sampler, np.array([s]))
        for s in (1.0, -1.0)
    )
    rays = np.linspace(-0.3, 0.3, 61)[None]
    images = [
        render(hand.own.moved((0, 0, 500)), rays, rays, [np.inf])[0] for hand in (right, left)
    ]
    np.testing.assert_allclose(images[0][:, ::-1], images[1], rtol=1e-4)
    np.testing.assert_allclose(right.palmar * (-1, 1, 1), left.palmar, atol=1e-12)
    assert np.isfinite(images[0]).sum() > 100
