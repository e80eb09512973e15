"""handpose/tracking/hand_track.py, with artificial estimates"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.sides import SIDES, Side, SideView
from handpose.estimate.finder import FoundHand
from handpose.estimate.hand import HandEstimate
from handpose.fit.body import WorldPose
from handpose.fit.depth_fit import DepthFit
from handpose.fit.pose_confidence import Judge
from handpose.fit.settings import FitSettings
from handpose.frames.cameras import NYU
from handpose.tracking.hand_track import FrameHands, HandTrack
from handpose.tracking.settings import TrackSettings
from handpose.tracking.sizing import SizeKeeper
from tests.support.views import frame_of

FRAME = 1 / 30  # in seconds
SECOND = 30  # in frames

SETTINGS = TrackSettings()
FOLLOW = SETTINGS.follow


class Estimator:
    """An estimator for a camera whose pixels are mm, with crops at the palm."""

    camera = SimpleNamespace(project=lambda place: place)
    the_fitter, judge = None, Judge(FitSettings())
    expected = SimpleNamespace(center_of=lambda body, camera: body.place)

    def palm_at(self, view: Any, start: np.ndarray) -> np.ndarray:
        """The start, 2 mm to the right."""
        return start + (2, 0, 0)


def frame_with(presence: float | None) -> Any:
    """A frame in which the finder sees every hand 7 mm farther right, or none."""

    def near(place: np.ndarray, within_mm: float) -> FoundHand | None:
        if presence is None:
            return None
        return FoundHand(presence, place + (7, 0, 0), np.ones((1, 1), bool))

    view = SimpleNamespace(camera=Estimator.camera)
    return SimpleNamespace(view=SimpleNamespace(of=lambda side: view), near=near)


SEEN, UNSEEN = frame_with(0.8), frame_with(None)


def estimate(
    side: Side = "right",
    x: float = 0.0,
    cost: float = 1.0,
    confidence: float = 1.0,
    error: float = 5.0,
    is_tracked: bool = True,
) -> HandEstimate:
    """An estimate of a hand of which only the place is known, at x mm."""
    one = np.ones(1)
    none = np.zeros((1, 3))
    place = np.array([x, 0, 600])
    fit = DepthFit(none[None], none, cost * one, none, np.full((1, 4), 3.0), one)
    hand = HandEstimate(
        side,
        np.zeros((128, 128), np.float32),
        place,
        300.0,
        NYU,
        none,
        fit,
        is_tracked=is_tracked,
        error_mm=error,
        confidence=confidence,
    )
    vars(hand).update(body=WorldPose(place, np.eye(3), np.zeros(4)), view_center_mm=place)
    return hand


def both(
    x: float = 0.0, right: float = 1.0, left: float = 1.0, **said: float
) -> list[HandEstimate]:
    """Estimates of one place as a right and as a left hand, with these costs."""
    return [estimate("right", x, right, **said), estimate("left", x, left, **said)]


def track(estimates: Sequence[HandEstimate], **options: Any) -> HandTrack:
    """A track that begins with these estimates at 0 s."""
    return HandTrack(Estimator(), SETTINGS, estimates, 0.0, **options)  # type: ignore[arg-type]


def followed(one: HandTrack, estimates: list[list[HandEstimate]], first: int = 1) -> HandTrack:
    """The track after a frame of each estimate, at 30 per second, in which all sides are also
    estimated again.
    """
    for n, again in enumerate(estimates, first):
        of_sides = [hand for hand in again if hand.hand in one.sides]
        assert one.take(of_sides, again, n * FRAME, (n - 1) * FRAME)
    return one


# --------------------------------------------------------------------------------------- which hand


@pytest.mark.parametrize(
    ("costs", "prior", "side", "decided"),
    [
        ([(1.0, 9.0)], 0.0, "right", SECOND),
        ([(9.0, 1.0)], 0.0, "left", SECOND),
        # one estimate does not decide, however low its cost
        ([(1e9, 1e-9)] + [(1.0, 1.3)] * 90, 0.0, "right", SECOND),
        ([(1.01, 1.0)], 0.0, "left", 3 * SECOND),  # a small difference takes longer
        ([(1.0, 1.0)], 1.0, "right", 3 * SECOND),  # nothing but what was known before
        ([(1.0, 1.0)], -1.0, "left", 3 * SECOND),
    ],
)
def test_the_mean_decides_which_hand_it_is(
    costs: list[tuple[float, float]], prior: float, side: Side, decided: int
) -> None:
    """Both sides are tracked until then; afterwards single estimates do not change the decision."""
    costs = costs * (100 // len(costs))
    one = track(both(right=costs[0][0], left=costs[0][1]), side_prior=prior)
    for n in count(1):
        followed(one, [both(right=costs[n][0], left=costs[n][1])], n)
        if one.is_decided:
            break
        regions = one.regions(n * FRAME, (n - 1) * FRAME)
        assert set(one.sides) == {region.side for region in regions} == set(SIDES)
        assert 0.5 <= one.side_confidence < 1 and one.decided is None
    assert abs(n - decided) <= 1
    opposite = both(right=9.0) if side == "right" else both(left=9.0)
    followed(one, [opposite] * SECOND, n + 1)
    assert list(one.sides) == [side] == [region.side for region in one.regions(9.0, 9.0 - FRAME)]
    assert one.hand == one.decided == one.best.estimate.hand == side
    assert one.side_confidence == 1


def test_an_unseen_side_is_no_evidence() -> None:
    """A side whose crop shows no hand counts against that side."""
    one = followed(track(both()), [[estimate("left")]] * 29)
    assert one.side_confidence == 0.5 and one.hand == "right"
    followed(one, [[estimate("right", cost=np.inf, confidence=0), estimate("left")]], 30)
    assert one.hand == one.best.estimate.hand == "left" and 0.5 < one.side_confidence < 0.7
    nothing = both(right=np.inf, left=np.inf, confidence=0)
    for n in range(31, 99):
        assert not one.take(nothing, nothing, n * FRAME, (n - 1) * FRAME)
    assert not one.is_decided


def test_only_one_side_is_looked_for() -> None:
    """If only one side is tracked, it is decided from the start."""
    one = track([estimate("left")], size=1.1)
    assert one.is_decided and one.decided == "left"
    assert [region.size for region in one.regions(FRAME, 0.0)] == [1.1]


def test_a_hand_that_returns_is_known() -> None:
    before, again = track([estimate("left")], size=1.1), track(both())
    again.identify(4, before)
    assert (again.id, again.size, again.decided) == (4, 1.1, "left")
    assert again.sizes is before.sizes
    new = track([estimate("right")])
    new.identify(5)
    assert (new.id, new.size, new.decided) == (5, None, "right")
    assert isinstance(new.sizes, SizeKeeper)


# --------------------------------------------------------------------------------------- where next


def moving(x: Sequence[float]) -> HandTrack:
    """A track of a hand at these places, one per frame from 0 s on."""
    return followed(track([estimate(x=x[0])]), [[estimate(x=place)] for place in x[1:]])


def expected_x(one: HandTrack, frame: int) -> float:
    """Where the only hand is looked for."""
    (region,) = one.regions(frame * FRAME, (frame - 1) * FRAME)
    assert region.before is not None and region.before.place[0] == region.center_uvd[0]
    return float(region.center_uvd[0])


def test_the_next_region_is_extrapolated() -> None:
    """The first region is at the hand; later ones move by no more than its velocity and for some
    time.
    """
    assert expected_x(moving([0.0]), 1) == 0
    one = moving([10.0 * n for n in range(10)])
    first, second, third, last = (expected_x(one, frame) for frame in (10, 12, 21, 99))
    assert 90 < first <= 100 and first < second <= 120
    assert second < third == pytest.approx(last)


@pytest.mark.parametrize(
    ("before", "found", "least", "most"),
    [
        # too far away for a motion: the hand moves on as before
        (range(0, 100, 10), 250, 256, 260),
        ([0, 0, 0], 180, 180, 180),
        ([0, 0, 0], 50, 65, 75),  # as far as a fast hand gets
    ],
)
def test_a_pose_found_anew_changes_the_velocity(
    before: Sequence[float], found: float, least: float, most: float
) -> None:
    """It does so unless it is too far away, but it does not change how the hand turns and bends."""
    one = moving([float(x) for x in before])
    hand = estimate(x=found, is_tracked=False)
    turned = hand.body._replace(rotation=np.diag([-1.0, -1.0, 1.0]), others=np.ones(4))
    vars(hand)["body"] = turned
    followed(one, [[hand]], len(before))
    expected = one.best.expected((len(before) + 1) * FRAME)
    assert least <= expected.place[0] <= most
    np.testing.assert_array_equal(expected.rotation, turned.rotation)
    np.testing.assert_array_equal(expected.others, turned.others)


def test_the_network_runs_only_in_some_frames_while_the_fit_is_good() -> None:
    """While the fit is not good, it runs in every frame."""
    one = track([estimate()])
    asked = []
    for n in range(1, 31):
        (region,) = one.regions(n * FRAME, (n - 1) * FRAME)
        asked.append(region.asks_network)
        followed(one, [[estimate()]], n)
    assert 0 < asked.count(True) < 15
    # After a frame without a pose.
    assert not one.take([estimate(confidence=0.1)], [], 31 * FRAME, 30 * FRAME)
    assert one.regions(32 * FRAME, 31 * FRAME)[0].asks_network
    undecided = track(both())
    for n in range(1, 9):
        regions = undecided.regions(n * FRAME, (n - 1) * FRAME)
        assert [region.asks_network for region in regions] == [True, True]


def test_an_uncertain_hand_is_estimated_again() -> None:
    """An uncertain hand gets a region at the palm that the network sees, from the finder's hand
    or the crop on.
    """
    one = track([estimate(x=5)], size=0.9)
    unsure = [estimate(x=20, confidence=0.6)]
    assert one.other_regions(SEEN, [estimate()], 1.0) == []
    (first,) = one.other_regions(SEEN, unsure, 1.0)
    assert (first.center_uvd[0], first.side, first.size) == (29, "right", 0.9)
    assert [region.center_uvd[0] for region in one.other_regions(UNSEEN, unsure, 1.0)] == [22]
    assert [region.center_uvd[0] for region in one.other_regions(UNSEEN, [], 1.0)] == [5]
    one.take(unsure, [], 1.0, 1.0 - FRAME)
    assert one.other_regions(SEEN, unsure, 1.0 + FRAME) == []  # too soon
    assert one.other_regions(SEEN, unsure, 1.0 + SECOND * FRAME) != []
    # both sides get a second region, however certain the estimates are
    undecided = track(both(x=5))
    regions = undecided.other_regions(SEEN, both(x=20), 1.0)
    found = [(region.center_uvd[0], region.side) for region in regions]
    assert found == [(29, "right"), (15, "left")]
    assert all(region.before is undecided.sides[region.side].estimate.body for region in regions)


@pytest.mark.parametrize(
    ("confidence", "least", "most"), [(0.6, 30, 50), (0.1, 70, 110)], ids=["unsure", "no pose"]
)
def test_second_estimates_are_rare(confidence: float, least: int, most: int) -> None:
    """Of 300 uncertain frames in ten seconds few get a second estimate; more if
    there is no pose.
    """
    one = track([estimate()])
    uncertain = [estimate(confidence=confidence)]
    count = 0
    for n in range(1, 301):
        regions = one.other_regions(SEEN, uncertain, n * FRAME)
        count += bool(regions)
        one.take(uncertain, uncertain if regions else None, n * FRAME, (n - 1) * FRAME)
    assert least <= count <= most


def test_the_best_of_several_estimates_is_used() -> None:
    """The estimate with the least expected error is used; a side without an estimate
    keeps its pose.
    """
    one = track(both())
    others = [estimate(x=2, error=4), estimate(x=3, error=6)]
    assert one.take([estimate(x=1, error=9)], others, FRAME, 0.0)
    right, left = one.sides["right"], one.sides["left"]
    assert (right.estimate.body.place[0], left.estimate.body.place[0]) == (2, 0)
    assert one.time == right.time == FRAME and left.time == 0
    assert one.take([estimate(x=4, error=1)], [estimate(x=5)], 2 * FRAME, FRAME)
    assert one.sides["right"].estimate.body.place[0] == 4


# ------------------------------------------------------------------------------------------- losing


@pytest.mark.parametrize("seen", [[], [estimate(confidence=0.1)]], ids=["nothing", "unlike"])
def test_a_track_ends_when_its_credit_is_used_up(seen: list[HandEstimate]) -> None:
    """A single frame without the hand does not end it; time with the hand renews the credit."""
    one = moving([0, 1])
    assert one.credit == pytest.approx(FOLLOW.first_credit + 2 * FRAME)
    smooth = one.best.smooth.place[0]
    assert not one.take(seen, seen, 2 * FRAME, FRAME)
    assert one.credit == pytest.approx(FOLLOW.first_credit + FRAME)
    assert one.time == FRAME
    assert (one.best.estimate.body.place[0], one.best.smooth.place[0]) == (1, smooth)
    followed(one, [[estimate(x=2)]] * 60, 3)
    assert one.time == 62 * FRAME and one.credit == FOLLOW.most_credit
    assert not one.take(seen, seen, 63 * FRAME + FOLLOW.most_credit, 62 * FRAME)
    assert one.credit < 0


def test_smoothing_begins_with_the_first_pose() -> None:
    assert moving([4.0]).best.smooth.place[0] == 4
    assert 0 < moving([0, 10, 10]).best.smooth.place[0] < 10


def test_the_evidence_is_that_of_the_finder_or_of_a_sure_pose() -> None:
    """The finder's last looks count."""
    one = track([estimate(confidence=0.5)], presence=0.6)
    assert one.hand_chance == one.looks.presence == 0.6
    one.look(SEEN)
    assert one.looks.presence == pytest.approx(0.7)
    one.look(UNSEEN)
    assert one.looks.presence == pytest.approx(0.35) and one.hand_chance == 0.5
    assert followed(one, [[estimate(confidence=0.9)]]).hand_chance == 0.9


def test_the_finder_looks_once_in_a_frame() -> None:
    looks: list[float] = []

    def look(view: SideView, min_presence: float, most: int) -> list[Any]:
        looks.append(min_presence)
        return [SimpleNamespace(middle=np.array([x, 0, 600])) for x in (0, 90, 400)]

    finder: Any = SimpleNamespace(hands_in=look)
    frame = FrameHands(finder, frame_of(np.zeros((2, 3), np.float32), NYU), 0.3)
    assert not looks and not frame.is_known
    assert frame.near(np.array([60.0, 0, 600]), 110) is frame.hands[1] and frame.is_known
    assert frame.near(np.array([250.0, 0, 600]), 110) is None and looks == [0.3]
