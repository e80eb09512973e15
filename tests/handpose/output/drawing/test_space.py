"""handpose/output/drawing/space.py"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handpose.output.drawing import hands
from handpose.output.drawing.space import Space
from handpose.output.drawing.strokes import Image
from handpose.tracking.track import TrackedHand
from tests.support.tracked_hands import HEADER, tracked


def shown(space: Space, time: float, drawn: Sequence[TrackedHand]) -> Image:
    space.see(time, np.concatenate([hand.xyz for hand in drawn]))
    return space.picture(drawn, 600, 500)


def rectangle(picture: Image, empty: Image) -> tuple[int, int, int, int]:
    rows, columns = np.nonzero((picture != empty).any(axis=2))
    return rows.min(), rows.max(), columns.min(), columns.max()


def test_two_hands_in_one_view() -> None:
    """Both hands are entirely visible, the right one on the left, as seen by the camera."""
    right, left = tracked("right", (-200, 0, 600)), tracked("left", (200, 50, 650), 2)
    space = Space(HEADER.skeleton)
    both = shown(space, 0.0, [right, left])
    empty = space.picture([], 600, 500)
    for hand in (right, left):
        top, bottom, first, last = rectangle(space.picture([hand], 600, 500), empty)
        assert top > 0 and bottom < 499 and first > 0 and last < 599
    assert rectangle(space.picture([right], 600, 500), empty)[2] < rectangle(space.picture([left], 600, 500), empty)[2]
    colours = {tuple(int(c) for c in colour) for colour in np.unique(both.reshape(-1, 3), axis=0)}
    assert set(hands.COLOURS.values()) <= colours


def test_the_floor_stands_still_while_the_hand_is_within() -> None:
    """The view moves gradually only when a hand is about to leave it."""
    space = Space(HEADER.skeleton)
    shown(space, 0.0, [tracked()])
    floor = space.picture([], 600, 500)
    for n in range(1, 10):
        shown(space, n / 30, [tracked(at=(6 * n, -4 * n, 600))])
    assert np.array_equal(space.picture([], 600, 500), floor)
    shown(space, 0.4, [tracked(at=(400, 0, 600))])
    assert not np.array_equal(space.picture([], 600, 500), floor)
    shown(space, 5.0, [tracked(at=(400, 0, 600))])
    picture = shown(space, 10.0, [tracked(at=(400, 0, 600))])
    _, _, first, last = rectangle(picture, space.picture([], 600, 500))
    assert first > 0 and last < 599


def test_a_lost_hand_leaves_the_floor() -> None:
    """The view does not move without hands; before the first hand the picture is blank."""
    space = Space(HEADER.skeleton)
    space.see(0.0, np.empty((0, 3)))
    assert (space.picture([], 60, 50) == 248).all()
    shown(space, 1.0, [tracked()])
    floor = space.picture([], 600, 500)
    space.see(9.0, np.empty((0, 3)))
    assert np.array_equal(space.picture([], 600, 500), floor)
