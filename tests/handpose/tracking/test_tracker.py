"""handpose/tracking/tracker.py, on short synthetic recordings with their truth"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.estimate import estimator
from handpose.estimate.finder import FoundHand
from handpose.estimate.hand import MIN_CONFIDENCE, HandEstimate
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import ICVL, NYU
from handpose.frames.images import UnitError
from handpose.frames.recording import DepthFrame
from handpose.tracking.hand_track import HandTrack
from handpose.tracking.reasons import NO_HAND
from handpose.tracking.settings import FollowSettings, TrackSettings
from handpose.tracking.track import LEFT, TrackedFrame
from handpose.tracking.tracker import Tracker, load_tracker
from netlib.errors import DataError, NetlibError
from tests.handpose.estimate.conftest import Said
from tests.handpose.tracking.conftest import RATE, Take, copied, error_of, tracked
from tests.support.tracked_hands import facts, lost


def again(predictor: Predictor, take: Take, frames: int = 8, **options: Any) -> list[TrackedFrame]:
    """The first frames of a recording, tracked by a new tracker."""
    return list(Tracker(predictor, **options).follow(take.frames[:frames]))


def plain(number: int, mm: float = 1380) -> DepthFrame:
    """A frame that shows a wall, or nothing at 0."""
    return DepthFrame(number, number / RATE, np.full((240, 320), mm, np.float32))


@pytest.fixture(scope="module")
def begun(predictor: Predictor, shown: Take) -> Callable[[], Tracker]:
    """``begun()``: a tracker that has seen the first six frames of the gestures."""
    made = Tracker(predictor, min_confidence=0)
    for frame in shown.frames[:6]:
        made.step(frame)
    return lambda: copied(made)


@pytest.fixture(scope="module")
def raw(predictor: Predictor, shown: Take) -> Take:
    """The gestures, tracked without smoothing."""
    return tracked(predictor, shown, smooth=False)


# ----------------------------------------------------------------------------------------- one hand


def test_a_hand_is_followed(shown: Take) -> None:
    """The hand is found in nearly every frame with one id, as a right hand, with a small error; no
    other hand is.
    """
    scores = shown.score()
    hand = scores.hands[0]
    assert scores.found > 0.95 and scores.invented == 0 and hand.id_switches == 0
    assert hand.wrong_side <= 3 and hand.error_mm < 15
    assert all(frame.hands or frame.lost for frame in shown.reported)
    assert [frame.number for frame in shown.reported] == list(range(45))
    assert [frame.time for frame in shown.reported] == [frame.time for frame in shown.frames]


def test_the_size_is_found_and_kept(shown: Take, raw: Take, predictor: Predictor) -> None:
    """The size is determined once, after some time, and bones are constant from then on."""
    true_bones = shown.truth[0].hands[0].pose.bones
    true = np.median(true_bones[1:]) / np.median(predictor.skeleton.bones[1:])
    for take in (shown, raw):
        bones = np.array([frame.hands[0].pose.bones for frame in take.reported])
        same = np.isclose(bones, bones[-1], rtol=1e-9).all(axis=1)
        first = int(same.argmax())
        assert RATE / 2 < first < len(bones) - 2 and same[first:].all()
        size = take.tracker.known[0].size
        np.testing.assert_allclose(bones[-1], size * predictor.skeleton.bones)
        assert size == pytest.approx(true, rel=0.1)


def test_a_size_that_is_given(shown: Take, predictor: Predictor) -> None:
    """It is used from the first frame on."""
    for frame in again(predictor, shown, 3, size=1.02, smooth=False):
        np.testing.assert_allclose(frame.hands[0].pose.bones, 1.02 * predictor.skeleton.bones)


def test_raw_and_smoothed(shown: Take, raw: Take) -> None:
    """Smoothing changes the reported poses, not how the hand is followed; the poses before it are
    reported, too.
    """
    for one, other in zip(shown.reported, raw.reported):
        assert (one.number, facts(one.lost)) == (other.number, facts(other.lost))
        for own, same in zip(one.hands, other.hands, strict=True):
            assert (own.id, own.hand) == (same.id, same.hand) and same.pose.raw_xyz is None
            np.testing.assert_array_equal(own.pose.center_uvd, same.pose.center_uvd)
            np.testing.assert_allclose(own.pose.raw_xyz, same.xyz, atol=1e-6)
    assert jerk(shown) < 0.95 * jerk(raw)
    assert shown.score().hands[0].error_mm < raw.score().hands[0].error_mm + 2


def jerk(take: Take) -> float:
    """The mean second difference of the joints from frame to frame, in mm."""
    xyz = [frame.hands[0].xyz for frame in take.reported]
    return float(np.linalg.norm(np.diff(xyz, 2, axis=0), axis=2).mean())


def test_frames_are_read_one_at_a_time(shown: Take, predictor: Predictor) -> None:
    """The next frame is read only after the previous one has been reported."""
    frames = iter(shown.frames)
    reported = Tracker(predictor).follow(frames)
    assert [next(reported).number, next(frames).number, next(reported).number] == [0, 1, 2]


def test_unsure_hands_are_followed_without_their_joints(predictor: Predictor, shown: Take) -> None:
    """By default and with another minimum confidence; a second run gives the same
    hands bit for bit.
    """
    least = float(np.median([frame.hands[0].confidence for frame in shown.reported[:12]]))
    for minimum, options in ((MIN_CONFIDENCE, {}), (least, {"min_confidence": least})):
        for frame, same in zip(again(predictor, shown, 12, **options), shown.reported):
            (hand,) = same.hands
            is_sure = hand.confidence >= minimum
            assert (len(frame.hands), len(frame.present)) == (is_sure, not is_sure)
            for one in frame.hands:
                assert one.confidence == hand.confidence
                for name in ("xyz", "raw_xyz", "inputs", "bones"):
                    np.testing.assert_array_equal(getattr(one.pose, name), getattr(hand.pose, name))


# ----------------------------------------------------------------------------------- lost and found


def test_a_hand_that_leaves_and_returns(leaving: Take) -> None:
    """It is reported, present while the finder sees a part of it, or lost, with the reason and
    when it was seen last, and keeps its id and side.
    """
    away = [true.number for true in leaving.truth if [lost.reason for lost in true.lost] == [LEFT]]
    while_away = [leaving.reported[number].lost for number in away]
    count = len(while_away)
    reasons = [lost[0].reason for lost in while_away if lost]
    assert count > 5 and len(reasons) >= count - 3
    assert sum(reason.startswith(LEFT) for reason in reasons) >= count - 5
    scores = leaving.score()
    hand = scores.hands[0]
    assert scores.found > 0.75 and hand.error_mm < 20
    assert hand.id_switches == 0 and hand.wrong_side <= 3
    since = None
    for frame in leaving.reported:
        assert [one.id for one in frame.every] == [0]
        since = frame.time if frame.hands else since
        for one in frame.lost:
            assert (one.hand, one.since) == ("left", since) and one.reason
    gone = [frame.lost[0] for frame in leaving.reported if frame.lost]
    assert gone[0].reason.startswith(LEFT) and leaving.reported[-1].hands


def test_a_hand_of_low_confidence_is_dropped(
    shown: Take, begun: Callable[[], Tracker], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is lost when its credit is used up."""
    tracker = begun()
    (track,), tracker.finder = tracker.tracks, Said()

    def doubtful(hands: list[HandEstimate], *_: object) -> list[HandEstimate]:
        return [dataclasses.replace(hand, error_mm=60.0, confidence=0.2) for hand in hands]

    monkeypatch.setattr(estimator, "judge", doubtful)
    assert tracker.step(shown.frames[6]).lost[0].reason == f"{NO_HAND} (confidence 20%)"
    for frame in shown.frames[7:24]:
        reported = tracker.step(frame)
        assert not reported.hands and reported.lost[0].reason
        assert track.is_tracked == (track.credit > 0)
    assert not track.is_tracked


def test_after_a_gap_in_time(shown: Take, begun: Callable[[], Tracker]) -> None:
    """A hand that is missing in one frame is still expected; after a gap it is lost at once,
    until it is found.
    """
    tracker = begun()
    reported = tracker.step(plain(6, 0))
    assert not reported.hands and len(tracker.tracks) == 1
    gone = lost(0, reported.lost[0].hand, 5 / RATE, "no depth in this frame")
    assert facts(reported.lost) == facts([gone])
    reported = tracker.step(plain(99, 1500))
    assert not reported.hands and not tracker.tracks
    assert reported.lost[0].reason.startswith("only background at its last position")
    for n in range(20):
        reported = tracker.step(DepthFrame(100 + n, (100 + n) / RATE, shown.frames[n].depth))
        if reported.hands:
            break
    assert [hand.id for hand in reported.hands] == [0] and not reported.lost


def seeing(tracker: Tracker, *places: tuple[float, ...]) -> Tracker:
    """The tracker with a finder that sees a hand at each place (x, y, z, presence)."""
    mask = np.ones((240, 320), bool)
    tracker.finder = Said(
        *(FoundHand(presence, np.array(place), mask) for *place, presence in places)
    )
    return tracker


def test_a_hand_that_only_the_finder_sees_is_present_without_joints(
    shown: Take, predictor: Predictor
) -> None:
    """Also in the frames between two looks; it is gone some looks after the finder has seen it
    last.
    """
    tracker = seeing(Tracker(predictor), (0.0, 60, 1400, 0.7))
    for n in range(12):
        found = tracker.step(plain(n))
        [present] = found.present
        assert not found.hands and present.place == (0, 60, 1400)
        assert present.presence == pytest.approx(0.7)
        assert present.is_seen and present.mask is not None
    seeing(tracker)
    for n in range(12, 16):
        [present] = tracker.step(plain(n)).present
        assert not present.is_seen and present.mask is None
    found = tracker.step(plain(16))
    assert found == TrackedFrame(16, 16 / RATE) and not tracker.tracks


@pytest.mark.parametrize(("presence", "is_tried"), [(0.32, False), (0.34, True)])
def test_a_pose_is_tried_where_one_could_be_sure_enough(
    predictor: Predictor, monkeypatch: pytest.MonkeyPatch, presence: float, is_tried: bool
) -> None:
    tracker, tried = Tracker(predictor), list[FoundHand]()
    monkeypatch.setattr(tracker, "_seen_at", lambda hand, *_: tried.append(hand) or [])
    seeing(tracker, (0.0, 60, 1400, presence)).step(plain(0))
    assert bool(tried) == is_tried


def test_a_place_out_of_sight(
    shown: Take, predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no crop can be taken, no hand is followed; the finder's is reported."""
    tracker = Tracker(predictor)

    def unseen(frame: Any, regions: list[Any], *others: Any) -> list[None]:
        return [None] * len(regions)

    monkeypatch.setattr(tracker.estimator, "in_regions", unseen)
    frame = tracker.step(shown.frames[0])
    assert not frame.hands and not frame.lost and [hand.id for hand in frame.present] == [0]


def test_a_hand_that_is_more_present_takes_the_place_of_a_doubtful_one(
    shown: Take, predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = TrackSettings(follow=FollowSettings(sure=2.0))
    tracker, frame = Tracker(predictor, hands=1, settings=settings), shown.frames[0]
    for n in range(settings.present.min_given):
        tracker.step(frame._replace(time=n / RATE))
    [track] = tracker.tracks
    monkeypatch.setattr(HandTrack, "hand_chance", 0.5)
    reported = seeing(tracker, (250.0, 60, 1400, 0.4)).step(frame._replace(time=1.0))
    assert reported.hands and track.is_tracked and not reported.present  # one hand at most
    seeing(tracker, (0.0, 60, 1400, 0.6), (250.0, 60, 1400, 0.9))
    # The mean presence of the other hand is 0.65.
    assert tracker.step(frame._replace(time=2.0)).hands and track.is_tracked
    reported = tracker.step(frame._replace(time=3.0))
    assert [lost.reason for lost in reported.lost] == ["another hand is more present"]
    assert not track.is_tracked
    assert [one.place for one in reported.present] == [(250, 60, 1400)]


# ------------------------------------------------------------------------------------ many and none


def test_two_hands(two: Take) -> None:
    """Each hand has its own id and the right side."""
    scores = two.score()
    assert scores.found > 0.6 and scores.invented == 0
    assert not any(hand.id_switches for hand in scores.hands.values())
    last = two.reported[-1].hands
    assert [hand.id for hand in last] == [0, 1]
    assert {hand.hand for hand in last} == {"right", "left"}
    assert all(error_of(hand, two.truth[-1]) < 25 for hand in last)


@pytest.mark.parametrize("apart", [0.2, 0.5])
def test_both_hands_are_found_at_once(two: Take, predictor: Predictor, apart: float) -> None:
    """Both hands are found in the first frame, and in every frame after a long gap."""
    pairs = zip(two.truth, two.reported)
    counts = [(len(true.hands), len(reported.hands)) for true, reported in pairs]
    first = counts.index((2, 2))
    some = two.frames[first : first + 6 : 2]
    frames = [frame._replace(time=apart * n) for n, frame in enumerate(some)]
    for reported in Tracker(predictor).follow(frames):
        assert {hand.hand for hand in reported.hands} == {"right", "left"}


def test_no_more_hands_than_are_wanted(two: Take, predictor: Predictor) -> None:
    """Only one of two hands is reported, always the same."""
    reported = again(predictor, two, 5, hands=1)
    assert {len(frame.hands) for frame in reported[1:]} == {1}
    assert not any(frame.lost for frame in reported)
    places = np.array([frame.hands[0].pose.origin_mm for frame in reported[1:]])
    assert np.ptp(places, axis=0).max() < 60


def doubled(tracker: Tracker, time: float) -> HandTrack:
    """A second track of the only tracked hand, begun at a time."""
    double = HandTrack(tracker.estimator, tracker.settings, [tracker.tracks[0].best.estimate], time)
    double.identify(1)
    tracker.known[1] = double
    return double


@pytest.mark.parametrize(("begun_s", "id"), [(-1.0, 1), (5 / RATE, 0)])
def test_two_tracks_of_one_hand_are_merged(
    shown: Take, begun: Callable[[], Tracker], begun_s: float, id: int
) -> None:
    """Of two tracks of one hand the better one goes on, with the older one's id; the
    other is not lost.
    """
    tracker = begun()
    double = doubled(tracker, 5 / RATE)
    double.begun = begun_s
    for frame in shown.frames[6:9]:
        reported = tracker.step(frame)
        assert [hand.id for hand in reported.hands] == [id] and not reported.lost
    assert [*tracker.known] == [id]


def test_of_two_hands_at_one_place_one_is_lost(shown: Take, begun: Callable[[], Tracker]) -> None:
    """They are two if their sides are different."""
    tracker = begun()
    tracker.known[0].decided = "left"
    assert doubled(tracker, 5 / RATE).decided == "right"
    tracker.step(shown.frames[6])
    reasons = sorted(track.reason for track in tracker.known.values())
    assert reasons == ["", "another hand is tracked at its position"]


def test_a_hand_that_is_found_twice_at_once_is_one(shown: Take, predictor: Predictor) -> None:
    x, y, z = shown.truth[0].hands[0].xyz.mean(axis=0)
    tracker = seeing(Tracker(predictor), (x - 40, y, z, 0.8), (x + 40, y, z, 0.7))
    for frame in shown.frames[:3]:
        reported = tracker.step(frame)
        assert len(reported.hands) == 1 and not reported.lost and not reported.present


# ------------------------------------------------------------------------ beside a hand with joints

ELSEWHERE = (-250.0, 60.0, 1400.0)


@pytest.fixture
def following(predictor: Predictor, shown: Take) -> Tracker:
    """A tracker with the default options that has seen the first six frames of the gestures."""
    tracker = Tracker(predictor)
    for frame in shown.frames[:6]:
        tracker.step(frame)
    return tracker


def seen_beside(tracker: Tracker, shown: Take, *presences: float) -> list[int]:
    """The number of present hands in each further frame, while the finder sees one at
    ELSEWHERE, thus present.
    """
    counts = []
    for frame, presence in zip(shown.frames[6:], presences):
        reported = seeing(tracker, (*ELSEWHERE, presence)).step(frame)
        assert len(reported.hands) == 1
        counts.append(len(reported.present))
    return counts


def test_beside_a_hand_with_joints_a_doubtful_place_is_not_present(
    shown: Take, following: Tracker
) -> None:
    assert not any(seen_beside(following, shown, *[0.7] * 12))


def test_a_place_of_high_presence_is_and_stays_present(shown: Take, following: Tracker) -> None:
    assert all(seen_beside(following, shown, *[0.9] * 4, *[0.4] * 10)[3:])


def test_a_place_with_a_doubtful_pose_is_not_present(
    shown: Take, following: Tracker, monkeypatch: pytest.MonkeyPatch
) -> None:
    doubtful = dataclasses.replace(following.tracks[0].best.estimate, confidence=0.6)
    monkeypatch.setattr(following, "_seen_at", lambda *_: [doubtful])
    assert not any(seen_beside(following, shown, *[0.5] * 8))


def test_a_hand_that_was_followed_remains_present(
    two: Take, predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = Tracker(predictor)
    for frame in two.frames[:6]:
        tracker.step(frame)
    kept, ended = tracker.tracks
    ended.end("hidden")
    monkeypatch.setattr(tracker, "_seen_at", lambda *_: [])
    seeing(tracker, (*ended.place, 0.4))
    *_, last = (tracker.step(frame) for frame in two.frames[6:])
    assert [hand.id for hand in last.hands] == [kept.id]
    assert np.allclose(last.present[0].place, ended.place)


@pytest.mark.parametrize("still", [False, True])
def test_a_second_hand_of_another_recording_is_found(
    shown: Take, predictor: Predictor, still: bool
) -> None:
    """Laid into the frames, the nearest depth in front: it is there in nearly all frames, and
    nothing else is.
    """
    tracker, other = Tracker(predictor), shown.frames[20:]
    counts = []
    for n, frame in enumerate(shown.frames[:16]):
        moved = np.roll(other[0 if still else n].depth, -150, axis=1)
        reported = tracker.step(frame._replace(depth=np.minimum(frame.depth, moved)))
        counts.append(len(reported.hands) + len(reported.present))
    assert max(counts) == 2 and np.mean(np.array(counts) == 2) > 0.9


@pytest.mark.parametrize("mm", [0, 250, 600, 1200, 3000])
def test_no_hand_is_tracked_without_readings_or_on_a_plane(
    begun: Callable[[], Tracker], predictor: Predictor, mm: float
) -> None:
    """A second without readings, or of a plane, as of a covered lens, has no hand, whether or not
    one was there.
    """
    new, tracker = Tracker(predictor), begun()
    for n in range(6, 21):
        frame = plain(n, mm)
        assert new.step(frame) == TrackedFrame(n, n / RATE)
        assert not tracker.step(frame).hands


def test_a_masked_frame_has_no_hands(shown: Take, predictor: Predictor) -> None:
    frame = DepthFrame(0, 0.0, np.ma.array(shown.frames[0].depth, mask=True))
    assert Tracker(predictor).step(frame) == TrackedFrame(0, 0.0)


@pytest.mark.parametrize("unread", [np.nan, np.inf, -1])
def test_readings_of_frames_from_other_programs(
    shown: Take, predictor: Predictor, unread: float
) -> None:
    """NaN, infinite and negative values are pixels without a reading."""
    depth = shown.frames[0].depth.copy()
    depth[:60] = 0
    tracked = [
        Tracker(predictor).step(DepthFrame(0, 0.0, np.where(depth > 0, depth, value)))
        for value in (0, unread)
    ]
    joints, same = (frame.hands[0].xyz for frame in tracked)
    assert_allclose(joints, same)


# ----------------------------------------------------------------------------------------- mistakes


def test_a_frame_of_another_size(begun: Callable[[], Tracker]) -> None:
    with pytest.raises(DataError, match=r"\(480, 640\), expected \(240, 320\) of camera 'icvl'"):
        begun().step(DepthFrame(7, 7 / RATE, np.full((480, 640), 700, np.float32)))


def test_an_image_without_its_time_is_rejected(begun: Callable[[], Tracker]) -> None:
    with pytest.raises(NetlibError, match="the frame is a ndarray; expected a DepthFrame"):
        next(begun().follow([np.zeros((240, 320), np.float32)]))  # type: ignore[list-item]


def test_times_must_ascend(shown: Take, begun: Callable[[], Tracker]) -> None:
    """Velocities would be undefined."""
    tracker = begun()
    for time in (5 / RATE, 0.0, float("nan"), float("inf"), "1", None):
        with pytest.raises(DataError, match=r"frame 9 is of \S+ s, after one of 0.333333 s"):
            tracker.step(DepthFrame(9, time, shown.frames[6].depth))
    assert tracker.step(shown.frames[6]).hands


def test_another_unit(shown: Take, begun: Callable[[], Tracker], predictor: Predictor) -> None:
    """Another unit raises an error at the first frame with readings; a speck in a later
    frame does not.
    """
    for factor in (0.001, -1):
        tracker = Tracker(predictor)
        tracker.step(plain(0, 0))
        with pytest.raises(UnitError, match="expected mm"):
            tracker.step(DepthFrame(1, 0.1, shown.frames[0].depth * np.float32(factor)))
    begun().step(DepthFrame(6, 6 / RATE, np.eye(240, 320, dtype=np.float32)))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hands", 0),
        ("hands", 101),
        ("hands", 1.5),
        ("hands", True),
        ("size", 0.6),
        *(
            (name, value)
            for name in ("min_confidence", "min_presence")
            for value in (-0.1, 1.1, np.nan, "0.3", None)
        ),
    ],
)
def test_invalid_options_are_rejected(predictor: Predictor, name: str, value: Any) -> None:
    with pytest.raises(NetlibError, match=f"^{name}[= ]{value!r}.* expected "):
        Tracker(predictor, **{name: value})


def test_predictors_of_other_kinds() -> None:
    with pytest.raises(NetlibError, match="needs a predictor with a fit and a finder"):
        Tracker(load_predictor(NYU, fit="no", hand="right"))


def test_load_tracker_applies_its_options() -> None:
    """The weights are the packaged ones."""
    tracker = load_tracker(ICVL, hand="left", fit="fast", seed=3, hands=1, smooth=False)
    header = tracker.header("a recording")
    assert (header.source, header.camera) == ("a recording", ICVL)
    assert (header.unit_mm, header.smoothed) == (150, False)
    assert tracker.limit == 1 and tracker.predictor.fitter.seed == 3
    assert tracker.predictor.sides == ("left",)
