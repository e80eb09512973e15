"""handpose/output/drawing/view.py"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.output.drawing.view import MARGIN, MAX_ZOOM, View, Window, box_of
from tests.support.tracked_hands import CAMERA, tracked

NEAR, FAR, BESIDE = tracked("right", (0, 0, 600)), tracked("left", (40, 0, 3000)), tracked("right", (-250, 0, 600))
WHOLE = View(0.0, 0.0, CAMERA.width, CAMERA.height)


def test_the_crop_is_in_the_middle() -> None:
    """The part has the frame's aspect ratio and shows the crop with a margin, at once for the first frame."""
    view, (left, top, right, bottom) = Window(CAMERA).see(5.0, [NEAR]), box_of(NEAR, CAMERA)
    assert view.width / view.height == pytest.approx(CAMERA.width / CAMERA.height)
    assert view.height == pytest.approx(MARGIN * (bottom - top))
    assert view.left + view.width / 2 == pytest.approx((left + right) / 2)


def test_box() -> None:
    """The box of a crop contains the cube's middle plane: 147 px * 300 mm / 600 mm."""
    left, top, right, bottom = box_of(NEAR, CAMERA)
    assert (right - left, bottom - top) == pytest.approx((73.5, 73.5)) and (left + right) / 2 == pytest.approx(80.5)


@given(st.lists(st.sampled_from([NEAR, FAR, BESIDE]), max_size=3), st.floats(0, 10))
def test_a_part_lies_within_the_frame(hands: list, time: float) -> None:
    """The part lies within the frame and is at least a fifth of it, for hands at any place."""
    window = Window(CAMERA)
    window.see(0.0, [NEAR])
    view = window.see(time, hands)
    assert view.left >= 0 and view.top >= 0
    assert view.left + view.width <= CAMERA.width + 1e-6 and view.top + view.height <= CAMERA.height + 1e-6
    assert CAMERA.width / MAX_ZOOM <= view.width * 1.0001


def test_it_moves_slowly() -> None:
    """Without hands the whole frame is shown, at once in the first frame and later after some seconds."""
    assert Window(CAMERA).see(0.0, []) == WHOLE
    window = Window(CAMERA)
    before = window.see(0.0, [NEAR])
    after = window.see(1 / 30, [])
    assert before.width < after.width < 1.06 * before.width
    np.testing.assert_allclose(window.see(10.0, []), WHOLE, atol=1e-3)
