"""handpose/tracking/present_hands.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.sides import SideView
from handpose.estimate.finder import FoundHand
from handpose.frames.cameras import ICVL
from handpose.tracking.present_hands import Changes, PresentHands, Taken
from handpose.tracking.settings import PresentSettings
from tests.support.views import frame_of

SETTINGS = PresentSettings()
STEP = 0.1  # s
NOTHING = np.zeros((1, 1), bool)


def surface(
    depth: float = 600.0, patch: float = 600.0, noise: float = 0.0, seed: int = 0
) -> SideView:
    """A plane with a patch of another depth about the camera's axis, and with noise."""
    z = np.full((ICVL.height, ICVL.width), depth, np.float32)
    z[90:150, 130:190] = patch
    return frame_of(z + noise * np.random.default_rng(seed).normal(size=z.shape), ICVL)


STILL = surface()


def seen(*places: tuple[float, float]) -> list[FoundHand]:
    """Hands at x mm, with a presence."""
    return [FoundHand(presence, np.array([x, 0, 600]), NOTHING) for x, presence in places]


def places_of(hands: PresentHands) -> list[tuple[int, float]]:
    """Numbers and x of what is there."""
    return [(one.id, float(one.hand.middle[0])) for one in hands.there]


def test_a_hand_begins_where_it_is_present_enough_and_goes_on_with_less() -> None:
    hands = PresentHands(0.3, SETTINGS)
    hands.see(seen((0, 0.4), (400, 0.2)), STILL, [], 0.0)
    assert places_of(hands) == [(0, 0)]
    hands.see(seen((60, 0.2), (400, 0.5)), STILL, [], STEP)
    assert places_of(hands) == [(1, 400), (0, 60)], "the most present first"
    assert [one.presence for one in hands.there] == pytest.approx([0.5, 0.3]), (
        "the mean of its looks"
    )
    hands.see([], STILL, [], 2 * STEP)
    assert places_of(hands) == [(1, 400), (0, 60)]
    hands.see([], STILL, [], 3 * STEP)
    assert places_of(hands) == []


def test_a_place_that_is_taken_is_no_further_hand() -> None:
    hands = PresentHands(0.3, SETTINGS)
    hands.see(seen((0, 0.9), (400, 0.9)), STILL, [Taken(np.array([50.0, 0, 600]), np.inf)], 0.0)
    assert places_of(hands) == [(0, 400)]
    arm = np.array([400.0, 50, 600])
    hands.see(seen((400, 0.9)), STILL, [Taken(arm, 0.8)], STEP)
    assert places_of(hands) == [(0, 400)], "the other hand is less evident"
    hands.see(seen((400, 0.9)), STILL, [Taken(arm, 0.9)], STEP)
    assert places_of(hands) == []


MOVING = [surface(patch=600.0 + 20 * (n % 2)) for n in range(8)]


def looked(frames: list[SideView], *places: tuple[float, float]) -> PresentHands:
    """What is there after a look at each frame, in which the finder sees the same places."""
    hands = PresentHands(0.25, SETTINGS)
    for n, frame in enumerate(frames):
        hands.see(seen(*places), frame, [], n * STEP)
    return hands


def test_a_place_that_stays_the_same_is_sure_only_by_a_high_presence_which_it_had_once() -> None:
    (place,) = looked([STILL] * 50, (0, SETTINGS.sure - 0.05)).there
    assert not place.is_sure
    hands = looked([STILL], (0, SETTINGS.sure), (400, 0.4))
    hands.see(seen((0, 0.4), (400, 0.8)), STILL, [], STEP)
    assert [one.id for one in hands.there if one.is_sure] == [0], "the mean of its looks counts"


def test_a_place_whose_surface_changes_is_sure_by_a_lower_presence() -> None:
    (place,) = looked(MOVING, (0, 0.6 * SETTINGS.sure)).there
    assert place.is_sure
    noisy = [surface(noise=3.0, seed=n) for n in range(8)]
    (place,) = looked(noisy, (0, SETTINGS.sure - 0.1)).there
    assert not place.is_sure and place.evidence < place.presence + 0.05, "noise is no change"


@pytest.mark.parametrize(
    ("frames", "ids"), [([STILL] * 8, [0, 1]), (MOVING, [0])], ids=["still", "moving"]
)
def test_a_still_place_is_reported_unless_a_more_present_one_moves(
    frames: list[SideView], ids: list[int]
) -> None:
    """The first place is where some of the frames change."""
    hands = looked(frames, (0, 0.31), (400, 0.3))
    assert [one.id for one in hands.evident] == ids
    for n in range(8, 16):
        hands.see(seen((400, 0.3)), STILL, [], n * STEP)
    assert [one.id for one in hands.evident] == [1], "alone in view"


@pytest.mark.parametrize(("seconds", "is_sure"), [(1.0, True), (1.5, False)])
def test_only_a_change_since_a_recent_look_is_evidence(seconds: float, is_sure: bool) -> None:
    hands = PresentHands(0.3, SETTINGS)
    hands.see([], STILL, [], 0.0)
    hands.see(seen((0, 0.5)), surface(patch=630.0), [], seconds)
    assert [one.is_sure for one in hands.there] == [is_sure]


@pytest.mark.parametrize(
    ("after", "share"),
    [
        (surface(patch=630.0), 1.0),
        (surface(patch=300.0), 0.0),
        (surface(660.0, 660.0), 0.0),
        (surface(noise=5.0), 0.0),
    ],
    ids=["farther", "behind another", "moved camera", "noise"],
)
def test_the_share_of_a_surface_that_changed(after: SideView, share: float) -> None:
    changes = Changes(after, surface(noise=1.0), PresentSettings(same_mm=100.0))
    assert changes.share_at(np.array([0.0, 0, 600])) == pytest.approx(share, abs=0.05)


def tries(hands: PresentHands, frames: int, at_once: bool, there: int = 1) -> list[int]:
    """The frames in which a pose is tried; the finder sees the hand in every ``there``-th."""
    tried = []
    for n in range(frames):
        hands.see(seen((0, 0.9)) if n % there == 0 else [], STILL, [], n * STEP)
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
