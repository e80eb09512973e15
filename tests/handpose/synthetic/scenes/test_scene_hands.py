"""handpose/synthetic/scenes/hands.py"""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.render import render
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.hands import draw_hands
from handpose.synthetic.whole_scenes import SceneGenerator


def test_left_hands_are_mirrored_right_hands() -> None:
    sampler = SceneGenerator().sampler
    right, left = (
        draw_hands(Draw(np.random.default_rng(5), 1), sampler, np.array([side]))
        for side in (1.0, -1.0)
    )
    rays = np.linspace(-0.3, 0.3, 61)[None]
    images = [
        render(hand.own.moved((0, 0, 500)), rays, rays, [np.inf])[0] for hand in (right, left)
    ]
    assert_allclose(images[0][:, ::-1], images[1], rtol=1e-4)
    assert_allclose(right.palmar * (-1, 1, 1), left.palmar, atol=1e-12)
    assert np.isfinite(images[0]).sum() > 100


def test_placed_hands_keep_their_shape() -> None:
    sampler = SceneGenerator().sampler
    hand = draw_hands(Draw(np.random.default_rng(5), 1), sampler, np.array([1.0]))
    upside_down = np.diag([-1.0, -1.0, 1.0])[None]
    placed = hand.placed(upside_down, np.array([[10.0, 20.0, 600.0]]))
    assert_allclose(placed.wrist, hand.wrist * (-1, -1, 1) + (10, 20, 600))
    assert_allclose(placed.palmar, hand.palmar * (-1, -1, 1))
    assert_array_equal(placed.own.radius_a, hand.own.radius_a)
