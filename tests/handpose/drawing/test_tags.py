"""handpose/drawing/tags.py"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.drawing.tags import HEIGHT, Tags

PLACES = st.lists(st.tuples(st.floats(-300, 900), st.floats(-300, 900)), min_size=1, max_size=4)


@given(PLACES)
def test_all_are_within_the_picture_and_none_covers_another(places: list[tuple[float, float]]) -> None:
    """Wherever hands are."""
    canvas = np.zeros((300, 400, 3), np.uint8)
    tags = Tags(canvas)
    areas = []
    for n, (left, bottom) in enumerate(places):
        before = canvas.copy()
        tags.add("right 93%", left, bottom, (n + 1, n + 1, n + 1))
        rows, columns = np.nonzero((canvas != before).any(axis=2))
        assert rows.max() - rows.min() + 1 == HEIGHT
        areas.append(len(np.unique(columns)) * HEIGHT)
    assert len(set(areas)) == 1  # as long as the first
    assert (canvas.any(axis=2)).sum() == sum(areas)


def test_a_tag_stands_where_it_was_asked_for() -> None:
    """Its lower left corner is there."""
    canvas = np.zeros((100, 300, 3), np.uint8)
    Tags(canvas).add("left", 40, 60, (0, 0, 200))
    rows, columns = np.nonzero(canvas.any(axis=2))
    assert (rows.max(), columns.min()) == (59, 40)


def test_long_words_become_small() -> None:
    """A reason that is longer than the picture is wide is written smaller."""
    canvas = np.zeros((100, 200, 3), np.uint8)
    Tags(canvas).add("left hand lost 12.3 s: " + "a long reason " * 4, 0, 100, (0, 0, 200))
    assert not canvas[:, -2:].any() or (canvas[-HEIGHT:, -2:] == (0, 0, 200)).all()
