"""handpose/output/drawing/view.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.body.gestures import Gesture
from handpose.output.drawing.view import (
    MARGIN,
    MAX_ZOOM,
    TAG_HEIGHT,
    Contrast,
    Tags,
    Viewport,
    ViewportFollower,
    box_of,
    colour_of,
    percent,
    spoken,
    spoken_loss,
)
from tests.support.tracked_hands import CAMERA, lost, present, tracked

NEAR = tracked("right", (0, 0, 600))
FAR = tracked("left", (40, 0, 3000))
BESIDE = tracked("right", (-250, 0, 600))
WHOLE = Viewport(0.0, 0.0, CAMERA.width, CAMERA.height)


def test_the_crop_is_in_the_middle() -> None:
    """The part has the frame's aspect ratio and shows the crop with a margin, at once for
    the first frame.
    """
    view, (left, top, right, bottom) = (
        ViewportFollower(CAMERA).see(5.0, [NEAR]),
        box_of(NEAR, CAMERA),
    )
    assert view.width / view.height == pytest.approx(CAMERA.width / CAMERA.height)
    assert view.height == pytest.approx(MARGIN * (bottom - top))
    assert view.left + view.width / 2 == pytest.approx((left + right) / 2)
    assert (right - left, bottom - top, left + right) == pytest.approx((73.5, 73.5, 161))


@given(st.lists(st.sampled_from([NEAR, FAR, BESIDE]), max_size=3), st.floats(0, 10))
def test_a_part_lies_within_the_frame(hands: list, time: float) -> None:
    follower = ViewportFollower(CAMERA)
    follower.see(0.0, [NEAR])
    view = follower.see(time, hands)
    assert view.left >= 0 and view.top >= 0
    assert view.left + view.width <= CAMERA.width + 1e-6
    assert view.top + view.height <= CAMERA.height + 1e-6
    assert CAMERA.width / MAX_ZOOM <= view.width * 1.0001


def test_the_window_moves_slowly() -> None:
    """Without hands the whole frame is shown, at once in the first frame and later
    after some seconds.
    """
    assert ViewportFollower(CAMERA).see(0.0, []) == WHOLE
    follower = ViewportFollower(CAMERA)
    before = follower.see(0.0, [NEAR])
    after = follower.see(1 / 30, [])
    assert before.width < after.width < 1.06 * before.width
    np.testing.assert_allclose(follower.see(10.0, []), WHOLE, atol=1e-3)


DEPTH = np.array([[0, 400, 600, 620, 1000, 3000, 70000]], np.float32)


@given(st.lists(st.floats(100, 5000), max_size=5))
def test_nearer_is_lighter(hands: list[float]) -> None:
    """Nearer pixels are lighter for hands at any depth; pixels without a reading, and only
    they, are black.
    """
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


def test_without_hands_the_nearer_half_of_the_scene_counts() -> None:
    """The nearer half of the readings has most of the greys; an image without readings
    raises no error.
    """
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


PLACES = st.lists(st.tuples(st.floats(-300, 900), st.floats(-300, 900)), min_size=1, max_size=4)


def test_colours() -> None:
    colours = [colour_of(id) for id in range(6)]
    assert len(set(colours)) == 6 and colour_of(6) in colours
    assert all(0.11 * blue + 0.59 * green + 0.3 * red < 140 for blue, green, red in colours)


def test_labels_have_the_side_and_the_confidence() -> None:
    """The confidence or presence is in whole per cent, omitted if unknown; a lost hand has the time
    and the reason.
    """
    assert spoken(tracked("right", confidence=0.934)) == "right 93%"
    assert spoken(tracked("left", confidence=float("nan"))) == "left"
    assert spoken(replace(tracked("left", confidence=0.49), side_confidence=0.7)) == "left? 49%"
    for name, label in (("thumb_up", "right 93%, thumb up"), ("", "right 93%")):
        assert spoken(replace(tracked(confidence=0.934), gesture=Gesture(name, 0.9))) == label
    assert [spoken(present(1, 0.43, 0.1, hand=side)) for side in ("left", None)] == [
        "left hand 43%",
        "hand 43%",
    ]
    assert [percent(sure) for sure in (0.0, 0.994, 0.996, 1.0)] == ["0%", "99%", ">99%", ">99%"]
    assert spoken_loss(lost(1, "left", 2.0), 2.43) == "left hand lost 0.4 s: hidden"
    assert spoken_loss(lost(1, None, 2.0), 2.43) == "hand lost 0.4 s: hidden"


@given(PLACES)
def test_labels_lie_within_the_picture_and_do_not_overlap(
    places: list[tuple[float, float]],
) -> None:
    """For hands at any place."""
    canvas = np.zeros((300, 400, 3), np.uint8)
    tags = Tags(canvas)
    areas = []
    for n, (left, bottom) in enumerate(places):
        before = canvas.copy()
        tags.add("right 93%", left, bottom, (n + 1, n + 1, n + 1))
        rows, columns = np.nonzero((canvas != before).any(axis=2))
        assert rows.max() - rows.min() + 1 == TAG_HEIGHT
        areas.append(len(np.unique(columns)) * TAG_HEIGHT)
    assert len(set(areas)) == 1  # every label is as long as the first
    assert (canvas.any(axis=2)).sum() == sum(areas)


def test_the_tag_of_an_assumed_side_has_inverted_colours() -> None:
    """The text is coloured on white; the tag has the same size, and its corner at
    the given point.
    """
    pair = np.zeros((2, 100, 300, 3), np.uint8)
    for canvas, sure in zip(pair, (True, False)):
        Tags(canvas).add("left? 49%", 40, 60, (0, 0, 200), sure=sure)
    rows, columns = np.nonzero(pair[0].any(axis=2))
    assert (rows.max(), columns.min()) == (59, 40)
    assert (pair[0].any(axis=2) == pair[1].any(axis=2)).all()
    white = (pair == 255).all(axis=-1).mean(axis=(1, 2))
    assert white[1] > 2 * white[0] > 0


def test_long_words_become_small() -> None:
    canvas = np.zeros((100, 200, 3), np.uint8)
    Tags(canvas).add("left hand lost 12.3 s: " + "a long reason " * 4, 0, 100, (0, 0, 200))
    assert not canvas[:, -2:].any() or (canvas[-TAG_HEIGHT:, -2:] == (0, 0, 200)).all()
