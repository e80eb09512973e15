"""handpose/tracking/following.py: by sights that were made by hand"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handpose.depth_fit.fit import DepthFit
from handpose.facts.sides import SIDES
from handpose.tracking.body_pose import Placed
from handpose.tracking.following import Follower
from handpose.tracking.looking import Aim, Sight

FRAME = 1 / 30


class FakeLooker:
    """Its crops are at the palm, and its locator sees the hand 7 mm farther right."""

    sides = SIDES

    def center_of(self, body: Placed, side: str) -> np.ndarray:
        """The place itself."""
        return body.place

    def hand_near(self, depth: np.ndarray, sight: Sight) -> np.ndarray:
        """Beside it."""
        return sight.body.place + (7, 0, 0)


LOOKER: Any = FakeLooker()
DEPTH = np.zeros((1, 1), np.float32)  # which it does not look at


def sight(
    side: str = "right",
    x: float = 0.0,
    doubt: float = 1.0,
    confidence: float = 1.0,
    error: float = 5.0,
    goes_on: bool = True,
) -> Sight:
    """A hand at x mm."""
    one, none = np.ones(1), np.zeros((1, 3))
    fit = DepthFit(none, one, none, none, one, doubt * one, error * one, confidence * one, none,
                   np.full((1, 5), 3.0), one)  # fmt: skip
    body = Placed(np.array([x, 0, 600]), np.eye(3), np.zeros(4))
    return Sight(Aim(body.place, side), body.place, np.zeros((128, 128), np.float32), fit, body, goes_on)


def both(x: float = 0.0, right: float = 1.0, left: float = 1.0, **said: float) -> list[Sight]:
    """One place seen as a right hand and as a left one, with these doubts."""
    return [sight("right", x, right, **said), sight("left", x, left, **said)]


def followed(one: Follower, sights: list[list[Sight]], first: int = 1, beside: list[Sight] | None = None) -> None:
    """Frame by frame at 30 frames/s, as the sides that are still looked for; ``beside``: second looks at each."""
    for n, seen in enumerate(sights, first):
        assert one.take([own for own in seen if own.aim.side in one.sides], beside or [], n * FRAME)


def compared(one: Follower, looks: list[list[Sight]], first: int = 1) -> None:
    """Second looks at both sides, one in each frame."""
    for n, seen in enumerate(looks, first):
        followed(one, [both()], n, seen)


# --------------------------------------------------------------------------------------------- which hand


@pytest.mark.parametrize(("right", "left", "side"), [(1.0, 9.0, "right"), (9.0, 1.0, "left")])
def test_which_hand_is_decided_and_kept(right: float, left: float, side: str) -> None:
    """Both are followed until looks enough have spoken; then one, whatever a single look says."""
    one = Follower(0, LOOKER, both(right=right, left=left), 0.0, None)
    assert set(one.sides) == set(SIDES) and not one.is_decided
    assert one.best.sight.aim.side == side and {aim.side for aim in one.aims(FRAME)} == set(SIDES)
    n = 0
    while not one.is_decided:
        n += 1
        compared(one, [both(right=right, left=left)], n)
        assert n < 30
    assert list(one.sides) == [side] and {aim.side for aim in one.aims(1.0)} == {side}
    says, other = both(right=right, left=left), both(right=left, left=right)
    compared(one, [other, says] * 30, n + 1)
    assert list(one.sides) == [side]


def test_the_sum_decides() -> None:
    """No look alone, however sure it is: most looks said right."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    compared(one, [both(right=1e9, left=1e-9)])
    assert not one.is_decided and one.best.sight.aim.side == "left"
    for n in range(2, 60):
        compared(one, [both(right=1, left=4)], n)
        if one.is_decided:
            break
    assert list(one.sides) == ["right"]


def test_at_last_the_many_decide() -> None:
    """Where every look says little."""
    one = Follower(0, LOOKER, both(right=1.01), 0.0, None)
    compared(one, [both(right=1.01)] * 29)
    assert list(one.sides) == ["left"]


def test_who_decided_in_bad_light_may_be_wrong() -> None:
    """If all looks say the other hand from then on, it becomes that one."""
    one = Follower(0, LOOKER, both(right=9), 0.0, None)
    compared(one, [both(right=9)] * 20)
    assert list(one.sides) == ["left"]
    compared(one, [both(left=9)], 21)
    assert list(one.sides) == ["left"]
    compared(one, [both(left=9, x=5)] * 20, 22)
    assert list(one.sides) == ["right"] and one.best.sight.body.place[0] in (0, 5)


@pytest.mark.parametrize(("leaning", "side"), [(1.0, "right"), (-1.0, "left")])
def test_what_else_is_known(leaning: float, side: str) -> None:
    """Decides where pictures do not."""
    one = Follower(0, LOOKER, both(), 0.0, None, leaning)
    assert one.best.sight.aim.side == side
    compared(one, [both()] * 29)
    assert list(one.sides) == [side]


def test_a_side_that_is_not_seen_says_nothing() -> None:
    """Where one place is out of sight the other is followed; what shows nothing at all speaks against its side."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    followed(one, [[sight("left")]] * 29, beside=[sight("left")])
    assert not one.is_decided
    compared(one, [[sight("right", doubt=np.inf, confidence=0), sight("left")]], 30)
    assert one.best.sight.aim.side == "left"
    nothing = both(right=np.inf, left=np.inf, confidence=0)
    for n in range(31, 60):
        assert not one.take(nothing, nothing, n * FRAME)
    assert not one.is_decided


def test_a_side_that_was_right_for_long() -> None:
    """The more looks spoke for it, the more it takes to change it."""
    needed = []
    for looks in (0, 2, 20):
        one = Follower(0, LOOKER, both(left=9), 0.0, None)
        compared(one, [both(left=9)] * 3)
        assert one.is_decided and one.hand == "right"
        compared(one, [both(left=9)] * looks, 4)
        n = 0
        while one.hand == "right":
            n += 1
            compared(one, [both(right=9)], 100 + n)
        needed.append(n)
    assert needed[0] < needed[1] < needed[2] < 12


def test_only_one_side_is_looked_for() -> None:
    """Then there is nothing to be decided."""
    one = Follower(3, LOOKER, [sight("left")], 0.0, 1.1)
    assert one.is_decided and one.id == 3 and [aim.size for aim in one.aims(FRAME)] == [1.1]


# --------------------------------------------------------------------------------------------- where next


def test_where_to_look_next() -> None:
    """First where it was; then farther in the direction that it moves, but not farther than it goes."""
    one = Follower(0, LOOKER, [sight(x=0)], 0.0, None)
    (aim,) = one.aims(FRAME)
    np.testing.assert_array_equal(aim.center_uvd, [0, 0, 600])
    assert aim.before is one.best.sight.body
    followed(one, [[sight(x=10.0 * n)] for n in range(1, 10)])
    (aim,) = one.aims(10 * FRAME)
    assert 90 < aim.center_uvd[0] <= 100 and aim.before is not None and aim.before.place[0] == aim.center_uvd[0]
    (later,) = one.aims(12 * FRAME)
    assert aim.center_uvd[0] < later.center_uvd[0] <= 120


def test_the_network_is_asked_now_and_then() -> None:
    """While all is well, sure or not; always while the hand is in trouble. In between the last one's answer counts."""
    one = Follower(0, LOOKER, [sight()], 0.0, None)
    asked = []
    for n in range(1, 31):
        (aim,) = one.aims(n * FRAME)
        asked.append(aim.moved_mm is None)
        assert asked[-1] or aim.moved_mm == 3
        followed(one, [[sight()]], n)
    assert 0 < sum(asked) < 15
    for n in range(31, 40):
        followed(one, [[sight(confidence=0.7, error=30)]], n)
        assert not one.is_sure and one.aims((n + 1) * FRAME)[0].moved_mm is None
    undecided = Follower(0, LOOKER, both(), 0.0, None)
    assert all(aim.moved_mm is None for n in range(1, 9) for aim in undecided.aims(n * FRAME))


def test_a_second_look() -> None:
    """Where nothing sure was seen: where a hand is seen near, as both hands; where it was, if nothing was seen."""
    one = Follower(0, LOOKER, [sight(x=5)], 0.0, 0.9)
    assert one.other_aims(DEPTH, [sight()], 1.0) == []
    unsure = [sight(x=20, confidence=0.6)]
    first = one.other_aims(DEPTH, unsure, 1.0)
    assert [(aim.center_uvd[0], aim.side) for aim in first] == [(27, "right"), (27, "left")]
    assert all(aim.size == 0.9 for aim in first) and first[0].before is one.best.sight.body
    assert one.other_aims(DEPTH, unsure, 1.0 + FRAME) == []
    assert [aim.center_uvd[0] for aim in one.other_aims(DEPTH, [None], 9.0)] == [5]


def test_a_second_look_at_both_sides() -> None:
    """While it is not decided, however sure what was seen is."""
    one = Follower(0, LOOKER, both(x=5), 0.0, None)
    aims = one.other_aims(DEPTH, both(x=20), 1.0)
    assert sorted((aim.center_uvd[0], aim.side) for aim in aims) == [(27, "left"), (27, "right")]
    assert all(aim.before is one.sides[aim.side].sight.body for aim in aims)


@pytest.mark.parametrize(
    ("error", "goes_on", "least", "most"),
    [(1.0, False, 12, 60), (5.0, False, 3, 11), (1.0, True, 3, 11)],
    ids=["helps", "does not", "finds the same pose"],
)
def test_second_looks_are_rare(error: float, goes_on: bool, least: int, most: int) -> None:
    """In ten seconds of 300 unsure frames; rarer where they find no better pose."""
    one, looks = Follower(0, LOOKER, [sight()], 0.0, None), 0
    for n in range(1, 301):
        seen = [sight(confidence=0.6)]
        aims = one.other_aims(DEPTH, seen, n * FRAME)
        looks += bool(aims)
        assert one.take(seen, [sight(confidence=0.6, error=error, goes_on=goes_on)] if aims else [], n * FRAME)
    assert least <= looks <= most


def test_the_other_hand_is_looked_for_soon() -> None:
    """While looks find it better: who was decided as the wrong hand is that for half a second, not for seconds."""
    one = Follower(0, LOOKER, [sight("left")], 0.0, None)
    for n in range(1, 200):
        seen = [sight("left", confidence=0.6, error=15)]
        aims = one.other_aims(DEPTH, seen, n * FRAME)
        right = sight("right", doubt=4.0, error=5)
        assert one.take(seen, [right, sight("left", doubt=9.0, error=15)] if aims else [], n * FRAME)
        if one.hand == "right":
            break
    assert n * FRAME < 0.6


def test_a_hand_in_trouble() -> None:
    """It fits much worse than this hand usually does: the network is asked, and soon it is looked at anew."""
    one = Follower(0, LOOKER, [sight(error=4)], 0.0, None)
    followed(one, [[sight(error=4)]] * 9)
    assert one.other_aims(DEPTH, [sight(error=5)], 10 * FRAME) == []
    bad = [sight(error=30)]
    assert one.other_aims(DEPTH, bad, 10 * FRAME)
    assert one.other_aims(DEPTH, bad, 10 * FRAME + 1e-3) == []
    assert one.other_aims(DEPTH, bad, 10 * FRAME + 0.2)
    followed(one, [bad], 10)
    assert one.is_sure and all(one.aims((11 + n) * FRAME)[0].moved_mm is None for n in range(3))
    often = Follower(0, LOOKER, [sight(error=30)], 0.0, None)
    followed(often, [bad] * 30)
    assert often.other_aims(DEPTH, bad, 9.0) == []


def test_of_several_looks_the_best_counts() -> None:
    """The one with the least expected error; a side of which nothing was seen stays as it was."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    assert one.take([sight("right", 1, error=9), None], [sight("right", 2, error=4), sight("right", 3, error=6)], FRAME)
    assert one.sides["right"].sight.body.place[0] == 2 and one.sides["left"].sight.body.place[0] == 0
    assert one.time == one.sides["right"].time == FRAME and one.sides["left"].time == 0


# ------------------------------------------------------------------------------------------------- losing


@pytest.mark.parametrize("seen", [[], [None, None], [sight(confidence=0.1), None]], ids=["nothing", "out", "unlike"])
def test_losing(seen: list[Sight | None]) -> None:
    """A frame without it is no end: it is looked for where it was, and given up after a while."""
    one = Follower(0, LOOKER, [sight()], 0.0, None)
    followed(one, [[sight(x=1)]])
    assert not one.take(seen, seen, 2 * FRAME)
    assert one.time == FRAME and one.best.sight.body.place[0] == 1 and not one.given_up(2 * FRAME)
    assert one.take([sight(x=2)], [], 3 * FRAME) and one.time == 3 * FRAME
    assert not one.given_up(4 * FRAME) and one.given_up(4 * FRAME + 2)


def test_smoothing_begins_with_the_first_pose() -> None:
    """And follows what was seen, not what was not."""
    one = Follower(0, LOOKER, [sight(x=0)], 0.0, None)
    assert one.best.smooth.place[0] == 0
    followed(one, [[sight(x=10)], [sight(x=10)]])
    before = one.best.smooth.place[0]
    assert 0 < before < 10
    one.take([None], [], 3 * FRAME)
    assert one.best.smooth.place[0] == before


def test_a_jump_is_no_movement() -> None:
    """A pose that was found anew, elsewhere, says nothing of speed: the hand goes on as it moved, from there."""
    one = Follower(0, LOOKER, [sight(x=0)], 0.0, None)
    followed(one, [[sight(x=10.0 * n)] for n in range(1, 10)])
    followed(one, [[sight(x=250.0, goes_on=False)]], 10)
    (aim,) = one.aims(11 * FRAME)
    assert 256 < aim.center_uvd[0] <= 260
    rests = Follower(0, LOOKER, [sight(x=0)], 0.0, None)
    followed(rests, [[sight(x=0)], [sight(x=0)], [sight(x=80, goes_on=False)]])
    assert rests.aims(4 * FRAME)[0].center_uvd[0] == 80


def test_a_likely_size() -> None:
    """Is looked for until the hand's own is known."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    assert {aim.size for aim in one.aims(FRAME)} == {None}
    one.likely = 0.9
    assert {aim.size for aim in one.aims(2 * FRAME)} == {0.9}
    one.size = 1.1
    assert {aim.size for aim in one.aims(3 * FRAME)} == {1.1}
