"""handpose/synthetic/scenes/cameras.py"""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.cameras import draw_cameras
from handpose.synthetic.scenes.draws import Draw

COUNT = 64


def test_pixels_and_points_agree() -> None:
    cameras = draw_cameras(Draw(np.random.default_rng(2), COUNT), scene_prior.load().view)
    u, v, z = np.full(COUNT, 30.0), np.full(COUNT, 90.0), np.full(COUNT, 700.0)
    pixels = cameras.pixels(cameras.at(u, v, z))
    assert_allclose(pixels, np.stack([u, v], axis=1))


def test_cameras_on_heads_look_down() -> None:
    cameras = draw_cameras(Draw(np.random.default_rng(2), COUNT), scene_prior.load().view)
    assert_allclose(np.linalg.norm(cameras.up, axis=1), 1)
    assert (cameras.up[cameras.on_head, 2] < -np.sin(np.deg2rad(14))).all()
    assert not (cameras.on_head & cameras.facing).any()
