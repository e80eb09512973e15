"""handpose/tracking/following.py: by sights that were made by hand"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handpose.fitting.depth.fit import DepthFit
from handpose.tracking.body_pose import Placed
from handpose.tracking.following import Follower
from handpose.tracking.looking import Aim, Sight

FRAME = 1 / 30
SIDES = ("right", "left")


class FakeLooker:
    """Its crops are at the palm, and its network sees that 7 mm farther right."""

    def center_of(self, body: Placed, side: str) -> np.ndarray:
        """The place itself."""
        return body.place

    def palm_seen(self, sight: Sight) -> np.ndarray:
        """Beside it."""
        return sight.body.place + (7, 0, 0)


LOOKER: Any = FakeLooker()


def sight(
    side: str = "right", x: float = 0.0, doubt: float = 1.0, confidence: float = 1.0, error: float = 5.0
) -> Sight:
    """A hand at x mm."""
    one, none = np.ones(1), np.zeros((1, 3))
    fit = DepthFit(none, one, none, none, one, doubt * one, error * one, confidence * one, none,
                   np.full((1, 5), 3.0), one)  # fmt: skip
    body = Placed(np.array([x, 0, 600]), np.eye(3), np.zeros(4))
    return Sight(Aim(body.place, side), body.place, np.zeros((128, 128), np.float32), fit, body)


def both(x: float = 0.0, right: float = 1.0, left: float = 1.0, **said: float) -> list[Sight]:
    """One place seen as a right hand and as a left one, with these doubts."""
    return [sight("right", x, right, **said), sight("left", x, left, **said)]


def followed(one: Follower, sights: list[list[Sight]], first: int = 1) -> None:
    """Frame by frame at 30 frames/s, as the sides that are still looked for."""
    for n, seen in enumerate(sights, first):
        assert one.take([own for own in seen if own.aim.side in one.sides], n * FRAME)


# --------------------------------------------------------------------------------------------- which hand


@pytest.mark.parametrize(("right", "left", "side"), [(1.0, 9.0, "right"), (9.0, 1.0, "left")])
def test_which_hand_is_decided_and_kept(right: float, left: float, side: str) -> None:
    """Both are followed until frames enough have spoken; then one, whatever is seen as the other."""
    one = Follower(0, LOOKER, both(right=right, left=left), 0.0, None)
    assert set(one.sides) == set(SIDES) and not one.is_decided
    assert one.best.sight.aim.side == side and {aim.side for aim in one.aims(FRAME)} == set(SIDES)
    n = 0
    while not one.is_decided:
        n += 1
        followed(one, [both(right=right, left=left)], n)
        assert n < 30
    assert n > 1 and list(one.sides) == [side] and {aim.side for aim in one.aims(1.0)} == {side}
    followed(one, [[sight(side, doubt=99)]] * 30, n + 1)
    assert list(one.sides) == [side]


def test_the_sum_decides() -> None:
    """Not the last frame, and no frame alone, however sure it is: most frames said right."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    followed(one, [both(right=1, left=5) if n % 3 else both(right=1e9, left=1e-9) for n in range(2)])
    assert not one.is_decided
    seen = [both(right=4, left=1) if n % 3 == 0 else both(right=1, left=4) for n in range(60)]
    for n, own in enumerate(seen, 3):
        followed(one, [own], n)
        if one.is_decided:
            break
    assert one.is_decided and one.best.sight.aim.side == "right"


def test_at_last_the_many_decide() -> None:
    """Where every frame says little."""
    one = Follower(0, LOOKER, both(right=1.01), 0.0, None)
    followed(one, [both(right=1.01)] * 29)
    assert one.is_decided and one.best.sight.aim.side == "left"


def test_a_side_that_is_not_seen_says_nothing() -> None:
    """Where one place is out of sight, or shows nothing, the other one is followed."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    followed(one, [[sight("left")]] * 29)
    assert not one.is_decided
    assert one.take([sight("right", doubt=np.inf, confidence=0), sight("left")], 1.0)
    assert one.best.sight.aim.side == "left"


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
    """While the hand is sure; otherwise always. In between the last one's answer counts."""
    one = Follower(0, LOOKER, [sight()], 0.0, None)
    asked = []
    for n in range(1, 31):
        (aim,) = one.aims(n * FRAME)
        asked.append(aim.moved_mm is None)
        assert asked[-1] or aim.moved_mm == 3
        followed(one, [[sight()]], n)
    assert 0 < sum(asked) < 15
    for n in range(31, 40):
        followed(one, [[sight(confidence=0.7)]], n)
        assert not one.is_sure and one.aims((n + 1) * FRAME)[0].moved_mm is None
    undecided = Follower(0, LOOKER, both(), 0.0, None)
    assert all(aim.moved_mm is None for n in range(1, 9) for aim in undecided.aims(n * FRAME))


def test_a_second_look() -> None:
    """Where nothing sure was seen: where it was, and where the network has the palm. Not in every frame."""
    one = Follower(0, LOOKER, [sight(x=5)], 0.0, 0.9)
    assert one.other_aims([sight()], 1.0) == []
    unsure = [sight(x=20, confidence=0.6)]
    first = one.other_aims(unsure, 1.0)
    assert [aim.center_uvd[0] for aim in first] == [5, 27]
    assert all(aim.side == "right" and aim.size == 0.9 and aim.before is one.best.sight.body for aim in first)
    assert one.other_aims(unsure, 1.0 + FRAME) == []
    assert one.other_aims([None], 3.0)[0].center_uvd[0] == 5
    times = [n for n in range(300) if one.other_aims(unsure, 4 + n * FRAME)]
    assert 10 < len(times) < 100


def test_of_several_looks_the_best_counts() -> None:
    """The one with the least expected error; a side of which nothing was seen stays as it was."""
    one = Follower(0, LOOKER, both(), 0.0, None)
    seen = [sight("right", 1, error=9), None, sight("right", 2, error=4), sight("right", 3, error=6)]
    assert one.take(seen, FRAME)
    assert one.sides["right"].sight.body.place[0] == 2 and one.sides["left"].sight.body.place[0] == 0
    assert one.time == one.sides["right"].time == FRAME and one.sides["left"].time == 0


# ------------------------------------------------------------------------------------------------- losing


@pytest.mark.parametrize("seen", [[], [None, None], [sight(confidence=0.1), None]], ids=["nothing", "out", "unlike"])
def test_losing(seen: list[Sight | None]) -> None:
    """A frame without it is no end: it is looked for where it was, and given up after a while."""
    one = Follower(0, LOOKER, [sight()], 0.0, None)
    followed(one, [[sight(x=1)]])
    assert not one.take(seen, 2 * FRAME)
    assert one.time == FRAME and one.best.sight.body.place[0] == 1 and not one.given_up(2 * FRAME)
    assert one.take([sight(x=2)], 3 * FRAME) and one.time == 3 * FRAME
    assert not one.given_up(4 * FRAME) and one.given_up(4 * FRAME + 2)


def test_smoothing_begins_with_the_first_pose() -> None:
    """And follows what was seen, not what was not."""
    one = Follower(0, LOOKER, [sight(x=0)], 0.0, None)
    assert one.best.smooth.place[0] == 0
    followed(one, [[sight(x=10)], [sight(x=10)]])
    before = one.best.smooth.place[0]
    assert 0 < before < 10
    one.take([None], 3 * FRAME)
    assert one.best.smooth.place[0] == before
