"""handpose/output/drawing/view.py"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.output.drawing.view import Contrast

DEPTH = np.array([[0, 400, 600, 620, 1000, 3000, 70000]], np.float32)


@given(st.lists(st.floats(100, 5000), max_size=5))
def test_nearer_is_lighter(hands: list[float]) -> None:
    """Nearer pixels are lighter for hands at any depth; pixels without a reading, and only they, are black."""
    contrast = Contrast()
    contrast.see(0.0, DEPTH, np.array(hands))
    grey = contrast.grey(DEPTH)[0].astype(int)
    assert grey[0] == 0 and (grey[1:] > 0).all()
    assert (np.diff(grey[1:]) <= 0).all()


def test_hands_get_most_of_the_greys() -> None:
    """Two centimetres are distinguishable at the hand, but not at the wall."""
    contrast = Contrast()
    contrast.see(0.0, DEPTH, np.array([580.0, 640.0]))
    near, far = contrast.grey(np.array([[600, 620], [3000, 3020]], np.float32)).astype(int)
    assert near[0] - near[1] >= 8 and far[0] == far[1]


def test_it_does_not_flicker() -> None:
    """A hand that jumps, or is lost, changes the greys by at most 20 from one frame to the next."""
    contrast = Contrast()
    contrast.see(0.0, DEPTH, np.array([600.0]))
    before = contrast.grey(DEPTH).astype(int)
    for n, hands in enumerate([[800.0], [], [], [500.0], [500.0, 900.0]]):
        contrast.see((n + 1) / 30, DEPTH, np.array(hands))
        after = contrast.grey(DEPTH).astype(int)
        assert abs(after - before).max() <= 20
        before = after


def test_it_follows_in_seconds() -> None:
    """After 10 seconds the contrast is as if the hand had always been there."""
    slow, fresh = Contrast(), Contrast()
    slow.see(0.0, DEPTH, np.array([400.0]))
    slow.see(10.0, DEPTH, np.array([900.0]))
    fresh.see(0.0, DEPTH, np.array([900.0]))
    assert abs(slow.grey(DEPTH).astype(int) - fresh.grey(DEPTH)).max() <= 1


def test_without_hands_the_nearer_half_of_the_scene_counts() -> None:
    """The nearer half of the readings has most of the greys; an image without readings raises no error."""
    scene = Contrast()
    scene.see(0.0, np.linspace(500, 1500, 6400, dtype=np.float32).reshape(80, 80), np.array([]))
    near, half, far = scene.grey(np.array([[510, 1000, 1500]], np.float32))[0].astype(int)
    assert near > 190 and near - half > 2 * (half - far) > 0
    contrast = Contrast()
    contrast.see(0.0, np.full((40, 40), 2500, np.float32), np.array([]))
    assert 100 < contrast.grey(np.array([[2500.0]], np.float32))[0, 0] < 150
    blind = Contrast()
    blind.see(0.0, np.zeros((40, 40), np.float32), np.array([]))
    assert blind.grey(np.zeros((4, 4), np.float32)).max() == 0
