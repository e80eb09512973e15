"""handpose/tracking/present_hands.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.estimate.finder import FoundHand
from handpose.tracking.present_hands import PresentHands, Taken
from handpose.tracking.settings import PresentSettings

SETTINGS = PresentSettings()
STEP = 0.1  # s
NOTHING = np.zeros((1, 1), bool)


def seen(*places: tuple[float, float]) -> list[FoundHand]:
    """Hands at x mm, with a presence."""
    return [FoundHand(presence, np.array([x, 0, 600]), NOTHING) for x, presence in places]


def places_of(hands: PresentHands) -> list[tuple[int, float]]:
    """Numbers and x of what is there."""
    return [(one.id, float(one.hand.middle[0])) for one in hands.there]


def test_a_hand_begins_where_it_is_present_enough_and_goes_on_with_less() -> None:
    hands = PresentHands(0.3, SETTINGS)
    hands.see(seen((0, 0.4), (400, 0.2)), [], 0.0)
    assert places_of(hands) == [(0, 0)]
    hands.see(seen((60, 0.2), (400, 0.5)), [], STEP)
    assert places_of(hands) == [(1, 400), (0, 60)], "the most present first"
    assert [one.presence for one in hands.there] == pytest.approx([0.5, 0.3]), (
        "the mean of its looks"
    )
    hands.see([], [], 2 * STEP)
    assert places_of(hands) == [(1, 400), (0, 60)]
    hands.see([], [], 3 * STEP)
    assert places_of(hands) == []


def test_a_place_that_is_taken_is_no_further_hand() -> None:
    hands = PresentHands(0.3, SETTINGS)
    hands.see(seen((0, 0.9), (400, 0.9)), [Taken(np.array([50.0, 0, 600]), np.inf)], 0.0)
    assert places_of(hands) == [(0, 400)]
    arm = np.array([400.0, 50, 600])
    hands.see(seen((400, 0.9)), [Taken(arm, 0.8)], STEP)
    assert places_of(hands) == [(0, 400)], "the other hand is less evident"
    hands.see(seen((400, 0.9)), [Taken(arm, 0.9)], STEP)
    assert places_of(hands) == []


def test_a_place_is_sure_by_a_presence_that_it_had_once_or_by_a_hand_that_was_followed_there() -> (
    None
):
    hands = PresentHands(0.3, SETTINGS)
    hands.see(seen((0, SETTINGS.sure), (400, SETTINGS.sure - 0.05), (800, 0.4)), [], 0.0)
    hands.see(seen((0, 0.4), (400, 0.4), (800, 0.8)), [], STEP)
    assert [(one.id, one.is_sure) for one in sorted(hands.there, key=lambda one: one.id)] == [
        (0, True),
        (1, False),
        (2, False),
    ], "the mean of its looks counts"
    (place,) = [one for one in hands.there if one.id == 1]
    place.was_followed = True
    assert place.is_sure


def tries(hands: PresentHands, frames: int, at_once: bool, there: int = 1) -> list[int]:
    """The frames in which a pose is tried; the finder sees the hand in every ``there``-th."""
    tried = []
    for n in range(frames):
        hands.see(seen((0, 0.9)) if n % there == 0 else [], [], n * STEP)
        for place in hands.due(n * STEP):
            place.wait(n * STEP, at_once)
            tried.append(n)
    return tried


def test_poses_are_tried_ever_more_seldom_beside_another_hand() -> None:
    tried = tries(PresentHands(0.3, SETTINGS), 200, at_once=False)
    pauses = np.diff(tried)
    assert (
        tried[0] == 0 and (np.diff(pauses) >= 0).all() and pauses[0] == 2 and 40 <= pauses[-1] <= 41
    )
    assert len(tries(PresentHands(0.3, SETTINGS), 200, at_once=False, there=7)) < 12, (
        "a place that comes and goes is no new one"
    )
    assert len(tries(PresentHands(0.3, SETTINGS), 200, at_once=True)) > 90
