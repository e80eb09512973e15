"""handpose/tracking/hand_track.py, with artificial estimates"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.sides import SIDES, Side
from handpose.estimate.hand import Hand
from handpose.fit.body import WorldPose
from handpose.fit.depth_fit import DepthFit
from handpose.frames.cameras import NYU, Camera
from handpose.tracking.hand_track import FIRST_CREDIT, MOST_CREDIT, FrameHands, HandTrack

FRAME = 1 / 30


class FakeCamera:
    """A camera for which mm are pixels."""

    def project(self, place: np.ndarray) -> np.ndarray:
        """The same."""
        return place

    unproject = project


class FakeEstimator:
    """An estimator whose crops are at the palm."""

    sides, camera = SIDES, FakeCamera()

    def center_of(self, body: WorldPose, side: Side) -> np.ndarray:
        """The place of the body."""
        return body.place

    def palm_at(self, depth: np.ndarray, start: np.ndarray, side: Side) -> np.ndarray:
        """The start, 2 mm to the right."""
        return start + (2, 0, 0)


class FakeHands:
    """A frame in which the finder sees every hand 7 mm farther right, or none."""

    depth = np.zeros((1, 1), np.float32)

    def __init__(self, presence: float = 0.8) -> None:
        self.presence = presence

    def near(self, place: np.ndarray) -> Any:
        """A hand at the place, 7 mm to the right."""
        if self.presence:
            return SimpleNamespace(middle=place + (7, 0, 0), presence=self.presence)
        return None


ESTIMATOR: Any = FakeEstimator()
SEEN: Any = FakeHands()
UNSEEN: Any = FakeHands(0.0)


class AtPlace(Hand):
    """A hand of which only the place is known."""

    def __init__(
        self, body: WorldPose, fit: DepthFit, side: Side, is_tracked: bool, quality: tuple[float, float]
    ) -> None:
        crop = np.zeros((128, 128), np.float32)
        super().__init__(side, crop, body.place, 300.0, NYU, np.zeros((1, 3)), fit, is_tracked=is_tracked,
                         error_mm=quality[0], confidence=quality[1])
        vars(self).update(body=body, center_mm=body.place)


def estimate(
    side: Side = "right",
    x: float = 0.0,
    cost: float = 1.0,
    confidence: float = 1.0,
    error: float = 5.0,
    goes_on: bool = True,
) -> Hand:
    """An estimate of a hand at x mm."""
    one, none = np.ones(1), np.zeros((1, 3))
    fit = DepthFit(none, one, none[None], none, cost * one, cost * one, none, np.full((1, 5), 3.0), one)
    body = WorldPose(np.array([x, 0, 600]), np.eye(3), np.zeros(4))
    return AtPlace(body, fit, side, goes_on, (error, confidence))


def both(x: float = 0.0, right: float = 1.0, left: float = 1.0, **said: float) -> list[Hand]:
    """Estimates of one place as a right and as a left hand, with these costs."""
    return [estimate("right", x, right, **said), estimate("left", x, left, **said)]


def followed(one: HandTrack, estimates: list[list[Hand]], first: int = 1, beside: list[Hand] | None = None) -> None:
    """Add a frame of each estimate, at 30 per second; ``beside`` are second estimates for every frame."""
    for n, seen in enumerate(estimates, first):
        assert one.take([own for own in seen if own.hand in one.sides], beside or [], n * FRAME)


def compared(one: HandTrack, seen: list[list[Hand]], first: int = 1) -> None:
    """Add estimates of both sides, one pair per frame, as first and as second ones."""
    for n, own in enumerate(seen, first):
        followed(one, [own], n, own)


# --------------------------------------------------------------------------------------------- which hand


SECOND = 31  # frames of the first comparison and of one second


@pytest.mark.parametrize(("right", "left", "side"), [(1.0, 9.0, "right"), (9.0, 1.0, "left")])
def test_which_hand_is_decided_and_kept(right: float, left: float, side: Side) -> None:
    """Both sides are tracked for a second; afterwards single estimates do not change the decision."""
    one = HandTrack(ESTIMATOR, both(right=right, left=left), 0.0, None)
    compared(one, [both(right=right, left=left)] * (SECOND - 2))
    assert set(one.sides) == set(SIDES) and not one.is_decided and 0.5 < one.side_confidence < 1
    assert one.best.estimate.hand == side and {region.side for region in one.regions(1.0)} == set(SIDES)
    compared(one, [both(right=right, left=left)], SECOND - 1)
    assert list(one.sides) == [side] and {region.side for region in one.regions(1.1)} == {side}
    assert one.is_decided and one.side_confidence == 1
    says, other = both(right=right, left=left), both(right=left, left=right)
    compared(one, [other, says] * 30, SECOND)
    assert list(one.sides) == [side]


def test_the_mean_decides() -> None:
    """No single estimate decides, however low its cost; most estimates are for the right hand."""
    one = HandTrack(ESTIMATOR, both(), 0.0, None)
    compared(one, [both(right=1e9, left=1e-9)])
    assert not one.is_decided and one.best.estimate.hand == "left"
    compared(one, [both(left=1.3)] * SECOND, 2)
    assert list(one.sides) == ["right"]


def test_small_differences_take_longer() -> None:
    """A small mean difference decides only after three seconds."""
    one = HandTrack(ESTIMATOR, both(right=1.01), 0.0, None)
    compared(one, [both(right=1.01)] * 88)
    assert not one.is_decided
    compared(one, [both(right=1.01)] * 3, 89)
    assert list(one.sides) == ["left"]


@pytest.mark.parametrize(("side_prior", "side"), [(1.0, "right"), (-1.0, "left")])
def test_what_else_is_known(side_prior: float, side: Side) -> None:
    """The prior of the side decides where the images do not."""
    one = HandTrack(ESTIMATOR, both(), 0.0, None, side_prior)
    assert one.best.estimate.hand == side
    compared(one, [both()] * 91)
    assert list(one.sides) == [side]


def test_a_side_that_is_not_seen_says_nothing() -> None:
    """A side out of sight is no evidence; a side whose crop shows no hand counts against that side."""
    one = HandTrack(ESTIMATOR, both(), 0.0, None)
    followed(one, [[estimate("left")]] * 29)
    assert one.side_confidence == 0.5
    compared(one, [[estimate("right", cost=np.inf, confidence=0), estimate("left")]], 30)
    assert one.best.estimate.hand == "left"
    nothing = both(right=np.inf, left=np.inf, confidence=0)
    for n in range(31, 99):
        assert not one.take(nothing, nothing, n * FRAME)
    assert not one.is_decided


def test_only_one_side_is_looked_for() -> None:
    """If only one side is tracked, it is decided from the start."""
    one = HandTrack(ESTIMATOR, [estimate("left")], 0.0, 1.1)
    assert one.is_decided and one.decided == "left" and [region.size for region in one.regions(FRAME)] == [1.1]


# --------------------------------------------------------------------------------------------- where next


def test_where_to_look_next() -> None:
    """The first region is at the hand; later ones are extrapolated, by no more than its velocity."""
    one = HandTrack(ESTIMATOR, [estimate(x=0)], 0.0, None)
    (region,) = one.regions(FRAME)
    np.testing.assert_array_equal(region.center_uvd, [0, 0, 600])
    assert region.before is one.best.estimate.body
    followed(one, [[estimate(x=10.0 * n)] for n in range(1, 10)])
    (region,) = one.regions(10 * FRAME)
    assert (
        90 < region.center_uvd[0] <= 100
        and region.before is not None
        and region.before.place[0] == region.center_uvd[0]
    )
    (later,) = one.regions(12 * FRAME)
    assert region.center_uvd[0] < later.center_uvd[0] <= 120


def test_the_network_is_asked_now_and_then() -> None:
    """The network runs in some frames while the fit is good, and in all others; in between its last error is reused."""
    one = HandTrack(ESTIMATOR, [estimate()], 0.0, None)
    asked = []
    for n in range(1, 31):
        (region,) = one.regions(n * FRAME)
        asked.append(region.moved_mm is None)
        assert asked[-1] or region.moved_mm == 3
        followed(one, [[estimate()]], n)
    assert 0 < sum(asked) < 15
    assert not one.take([estimate(confidence=0.1)], [], 31 * FRAME)
    assert one.regions(32 * FRAME)[0].moved_mm is None, "it had no pose in the frame before"
    undecided = HandTrack(ESTIMATOR, both(), 0.0, None)
    assert all(region.moved_mm is None for n in range(1, 9) for region in undecided.regions(n * FRAME))


def test_a_second_look() -> None:
    """An uncertain hand gets a region at the palm that the network sees, from the finder's hand or the crop on."""
    one = HandTrack(ESTIMATOR, [estimate(x=5)], 0.0, 0.9)
    assert one.other_regions(SEEN, [estimate()], 1.0) == []
    unsure = [estimate(x=20, confidence=0.6)]
    first = one.other_regions(SEEN, unsure, 1.0)
    assert [(region.center_uvd[0], region.side) for region in first] == [(29, "right")]
    assert first[0].size == 0.9 and first[0].before is one.best.estimate.body
    assert one.other_regions(SEEN, unsure, 1.0 + FRAME) == []
    assert [region.center_uvd[0] for region in one.other_regions(UNSEEN, unsure, 4.0)] == [22]
    assert [region.center_uvd[0] for region in one.other_regions(UNSEEN, [], 9.0)] == [5]


def test_a_second_look_at_both_sides() -> None:
    """While the side is undecided, both sides get a second region, however certain the estimates are."""
    one = HandTrack(ESTIMATOR, both(x=5), 0.0, None)
    regions = one.other_regions(SEEN, both(x=20), 1.0)
    assert sorted((region.center_uvd[0], region.side) for region in regions) == [(29, "left"), (29, "right")]
    assert all(region.before is one.sides[region.side].estimate.body for region in regions)


@pytest.mark.parametrize(("confidence", "least", "most"), [(0.6, 30, 50), (0.1, 70, 110)], ids=["unsure", "no pose"])
def test_second_looks_are_rare(confidence: float, least: int, most: int) -> None:
    """Of 300 uncertain frames in ten seconds few get a second estimate; more if there is no pose."""
    one, looks = HandTrack(ESTIMATOR, [estimate()], 0.0, None), 0
    for n in range(1, 301):
        seen = [estimate(confidence=confidence)]
        regions = one.other_regions(SEEN, seen, n * FRAME)
        looks += bool(regions)
        one.take(seen, seen if regions else [], n * FRAME)
    assert least <= looks <= most


def test_of_several_looks_the_best_counts() -> None:
    """The estimate with the least expected error is used; a side without an estimate keeps its pose."""
    one = HandTrack(ESTIMATOR, both(), 0.0, None)
    assert one.take(
        [estimate("right", 1, error=9)], [estimate("right", 2, error=4), estimate("right", 3, error=6)], FRAME
    )
    assert one.sides["right"].estimate.body.place[0] == 2 and one.sides["left"].estimate.body.place[0] == 0
    assert one.time == one.sides["right"].time == FRAME and one.sides["left"].time == 0


# ------------------------------------------------------------------------------------------------- losing


@pytest.mark.parametrize("seen", [[], [estimate(confidence=0.1)]], ids=["nothing", "unlike"])
def test_losing(seen: list[Hand]) -> None:
    """A frame without the hand does not end its track: its credit does, which time with the hand renews."""
    one = HandTrack(ESTIMATOR, [estimate()], 0.0, None)
    assert one.credit == FIRST_CREDIT
    followed(one, [[estimate(x=1)]])
    credit = one.credit
    assert not one.take(seen, seen, 2 * FRAME) and one.credit == pytest.approx(credit - FRAME)
    assert one.time == FRAME and one.best.estimate.body.place[0] == 1
    assert one.take([estimate(x=2)], [], 3 * FRAME) and one.time == 3 * FRAME
    followed(one, [[estimate(x=2)]] * 60, 4)
    assert one.credit == MOST_CREDIT
    assert not one.take(seen, seen, 70 * FRAME + MOST_CREDIT) and one.credit < 0


def test_smoothing_begins_with_the_first_pose() -> None:
    """Smoothing starts at the first pose, and ignores frames without the hand."""
    one = HandTrack(ESTIMATOR, [estimate(x=0)], 0.0, None)
    assert one.best.smooth.place[0] == 0
    followed(one, [[estimate(x=10)], [estimate(x=10)]])
    before = one.best.smooth.place[0]
    assert 0 < before < 10
    one.take([], [], 3 * FRAME)
    assert one.best.smooth.place[0] == before


def test_a_jump_is_no_movement() -> None:
    """A pose found anew too far away does not change the velocity."""
    one = HandTrack(ESTIMATOR, [estimate(x=0)], 0.0, None)
    followed(one, [[estimate(x=10.0 * n)] for n in range(1, 10)])
    followed(one, [[estimate(x=250.0, goes_on=False)]], 10)
    (region,) = one.regions(11 * FRAME)
    assert 256 < region.center_uvd[0] <= 260
    rests = HandTrack(ESTIMATOR, [estimate(x=0)], 0.0, None)
    followed(rests, [[estimate(x=0)], [estimate(x=0)], [estimate(x=180, goes_on=False)]])
    assert rests.regions(4 * FRAME)[0].center_uvd[0] == 180


def test_a_fast_start_is_a_movement() -> None:
    """A pose found anew where a fast hand may be changes the velocity, but not how the hand turns and bends."""
    one = HandTrack(ESTIMATOR, [estimate(x=0)], 0.0, None)
    followed(one, [[estimate(x=0)], [estimate(x=0)]])
    found = estimate(x=50, goes_on=False)
    turned = found.body._replace(rotation=np.diag([-1.0, -1.0, 1.0]), others=np.ones(4))
    vars(found)["body"] = turned
    followed(one, [[found]], 3)
    expected = one.best.expected(4 * FRAME)
    assert 65 < expected.place[0] < 75
    np.testing.assert_array_equal(expected.rotation, found.body.rotation)
    np.testing.assert_array_equal(expected.others, found.body.others)


# ---------------------------------------------------------------------------------------------------- presence


def test_how_sure_it_is_that_it_is_a_hand() -> None:
    """The finder's last looks count, or a sure pose."""
    one = HandTrack(ESTIMATOR, [estimate(confidence=0.5)], 0.0, presence=0.6)
    assert one.evidence == one.presence == 0.6
    one.look(SEEN)
    assert one.presence == pytest.approx(0.7)
    one.look(UNSEEN)
    assert one.presence == pytest.approx(0.35) and one.evidence == 0.5
    followed(one, [[estimate(confidence=0.9)]])
    assert one.evidence == 0.9


def test_the_finder_looks_once_in_a_frame() -> None:
    looks: list[float] = []

    def hand(x: float) -> Any:
        return SimpleNamespace(middle=np.array([x, 0, 600]))

    def look(depth: np.ndarray, camera: Camera, min_presence: float, most: int) -> list[Any]:
        looks.append(min_presence)
        return [hand(0), hand(90), hand(400)]

    finder: Any = SimpleNamespace(hands=look)
    frame = FrameHands(finder, np.zeros((2, 3), np.float32), NYU, 0.3)
    assert not looks
    assert frame.near(np.array([60.0, 0, 600])) is frame.hands[1]
    assert frame.near(np.array([250.0, 0, 600])) is None and looks == [0.3]
