"""handpose/output/drawing/view.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.output.drawing.view import HEIGHT, Tags, colour_of, percent, spoken, spoken_loss
from handpose.tracking.track import LostHand
from tests.support.tracked_hands import tracked

PLACES = st.lists(st.tuples(st.floats(-300, 900), st.floats(-300, 900)), min_size=1, max_size=4)


def test_colours() -> None:
    """Hands seen together have different colours, each dark enough for white letters."""
    colours = [colour_of(id) for id in range(6)]
    assert len(set(colours)) == 6 and colour_of(6) in colours
    assert all(0.11 * blue + 0.59 * green + 0.3 * red < 140 for blue, green, red in colours)


def test_words() -> None:
    """The confidence is in whole per cent, omitted if unknown; a lost hand has the time and the reason."""
    assert spoken(tracked("right", confidence=0.934)) == "right 93%"
    assert spoken(tracked("left", confidence=float("nan"))) == "left"
    assert spoken(replace(tracked("left", confidence=0.49), side_confidence=0.7)) == "left? 49%"
    assert [percent(sure) for sure in (0.0, 0.994, 0.996, 1.0)] == ["0%", "99%", ">99%", ">99%"]
    assert spoken_loss(LostHand(1, "left", 2.0, "left the image"), 2.43) == "left hand lost 0.4 s: left the image"
    assert spoken_loss(LostHand(1, None, 2.0, "left the image"), 2.43) == "hand lost 0.4 s: left the image"


@given(PLACES)
def test_all_are_within_the_picture_and_none_covers_another(places: list[tuple[float, float]]) -> None:
    """Labels lie within the picture and do not overlap, for hands at any place."""
    canvas = np.zeros((300, 400, 3), np.uint8)
    tags = Tags(canvas)
    areas = []
    for n, (left, bottom) in enumerate(places):
        before = canvas.copy()
        tags.add("right 93%", left, bottom, (n + 1, n + 1, n + 1))
        rows, columns = np.nonzero((canvas != before).any(axis=2))
        assert rows.max() - rows.min() + 1 == HEIGHT
        areas.append(len(np.unique(columns)) * HEIGHT)
    assert len(set(areas)) == 1  # every label is as long as the first
    assert (canvas.any(axis=2)).sum() == sum(areas)


def test_a_tag_stands_where_it_was_asked_for() -> None:
    """The label's lower left corner is at the requested place."""
    canvas = np.zeros((100, 300, 3), np.uint8)
    Tags(canvas).add("left", 40, 60, (0, 0, 200))
    rows, columns = np.nonzero(canvas.any(axis=2))
    assert (rows.max(), columns.min()) == (59, 40)


def test_a_side_that_is_assumed_has_another_tag() -> None:
    """The text is coloured on white, and the tag has the same place and size."""
    pair = np.zeros((2, 100, 300, 3), np.uint8)
    for canvas, sure in zip(pair, (True, False)):
        Tags(canvas).add("left? 49%", 40, 60, (0, 0, 200), sure=sure)
    assert (pair[0].any(axis=2) == pair[1].any(axis=2)).all()
    white = (pair == 255).all(axis=-1).mean(axis=(1, 2))
    assert white[1] > 2 * white[0] > 0


def test_long_words_become_small() -> None:
    """Text longer than the picture's width is written smaller."""
    canvas = np.zeros((100, 200, 3), np.uint8)
    Tags(canvas).add("left hand lost 12.3 s: " + "a long reason " * 4, 0, 100, (0, 0, 200))
    assert not canvas[:, -2:].any() or (canvas[-HEIGHT:, -2:] == (0, 0, 200)).all()
