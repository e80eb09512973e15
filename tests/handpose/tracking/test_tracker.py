"""handpose/tracking/tracker.py, on short synthetic recordings with their truth"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from handpose.estimate import estimator
from handpose.estimate.finder import FoundHand
from handpose.estimate.hand import Hand
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import ICVL, NYU
from handpose.frames.images import UnitError
from handpose.frames.recording import DepthFrame
from handpose.tracking.hand_track import HandTrack
from handpose.tracking.reasons import NO_HAND
from handpose.tracking.track import LEFT, LostHand, TrackedFrame, TrackedHand, joints_of
from handpose.tracking.tracker import Tracker, load_tracker
from netlib.errors import DataError, NetlibError
from tests.handpose.tracking.conftest import RATE, Take, copied, tracked

SOME = 8  # frames of a recording that are tracked again


def again(predictor: Predictor, take: Take, frames: int = SOME, **options: object) -> list[TrackedFrame]:
    """The first frames, tracked by a new tracker."""
    return list(Tracker(predictor, **options).follow(take.frames[:frames]))  # type: ignore[arg-type]


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


# ---------------------------------------------------------------------------------------------- one hand


def test_a_hand_is_followed(shown: Take) -> None:
    """The hand is found in nearly every frame with one id, as a right hand, with a small error; no other hand is."""
    scores = shown.score()
    hand = scores.hands[0]
    assert scores.found > 0.95 and scores.invented == 0 and hand.id_switches == 0
    assert hand.wrong_side <= 3 and hand.error_mm < 15
    assert all(frame.hands or frame.lost for frame in shown.reported)
    assert [frame.number for frame in shown.reported] == list(range(45))
    assert [frame.time for frame in shown.reported] == [frame.time for frame in shown.frames]


def test_better_than_frame_by_frame(shown: Take, predictor: Predictor) -> None:
    """In every eighth frame the tracked error is lower than that of the same network and plan on single frames."""
    errors = []
    for frame, reported, truth in list(zip(shown.frames, shown.reported, shown.truth))[4::8]:
        alone = predictor.in_frame(frame.depth)
        true = truth.hands[0].xyz
        errors.append([np.linalg.norm(xyz - true, axis=1).mean() for xyz in (reported.hands[0].xyz, alone.xyz)])
    tracked, alone_mm = np.mean(errors, axis=0)
    assert tracked < alone_mm


def test_joints_are_those_of_the_inputs(shown: Take, leaving: Take) -> None:
    """Joints follow from inputs, bones and origin; the crop is about the hand, and the confidence is a probability."""
    for take in (shown, leaving):
        assert take.tracker is not None
        header = take.tracker.header("a recording")
        for hand in (hand for frame in take.reported for hand in frame.hands):
            xyz = joints_of(header.skeleton, header.unit_mm, hand.hand, hand.inputs, hand.bones, hand.origin_mm)
            np.testing.assert_allclose(xyz, hand.xyz, atol=1e-6)
            np.testing.assert_allclose(ICVL.project(hand.origin_mm), hand.center_uvd, atol=1e-6)
            assert np.linalg.norm(hand.xyz.mean(axis=0) - hand.origin_mm) < 150 and hand.cube_mm == 300
            assert 0 <= hand.confidence <= 1 and hand.error_mm > 0 and hand.capsules is None


def test_the_size_is_found_and_kept(shown: Take, raw: Take, predictor: Predictor) -> None:
    """The size is determined once, after some time, and bones are constant from then on."""
    sizes = [known[0] for known in shown.sizes]
    first = next(n for n, size in enumerate(sizes) if size is not None)
    assert RATE / 2 < first < len(sizes) and set(sizes[first:]) == {sizes[first]}
    true = np.median(shown.truth[0].hands[0].bones[1:]), np.median(predictor.skeleton.bones[1:])
    assert sizes[first] == pytest.approx(true[0] / true[1], rel=0.1)
    for take in (shown, raw):
        after = np.array([frame.hands[0].bones for frame in take.reported[first + 1 :]])
        assert len(after) > 2
        np.testing.assert_allclose(after, np.tile(sizes[first] * predictor.skeleton.bones, (len(after), 1)))


def test_a_size_that_is_given(shown: Take, predictor: Predictor) -> None:
    """A given size is used from the first frame on."""
    reported = again(predictor, shown, 3, size=1.02, smooth=False)
    for frame in reported:
        np.testing.assert_allclose(frame.hands[0].bones, 1.02 * predictor.skeleton.bones)


def test_raw_and_smoothed(shown: Take, raw: Take) -> None:
    """Smoothing changes only the reported poses and their confidence; motion is smoother, the error hardly
    changes. The poses before smoothing are reported, too."""
    for one, other in zip(shown.reported, raw.reported):
        assert (one.number, one.lost) == (other.number, other.lost)
        for own, same in zip(one.hands, other.hands, strict=True):
            assert (own.id, own.hand) == (same.id, same.hand)
            np.testing.assert_array_equal(own.center_uvd, same.center_uvd)
    smooth_xyz, raw_xyz = (
        np.array([frame.hands[0].xyz for frame in reported]) for reported in (shown.reported, raw.reported)
    )
    assert not np.allclose(smooth_xyz, raw_xyz, atol=1)
    beside = np.array([frame.hands[0].raw_xyz for frame in shown.reported])
    np.testing.assert_allclose(beside, raw_xyz, atol=1e-6)
    assert all(frame.hands[0].raw_xyz is None for frame in raw.reported)
    restless = [np.linalg.norm(np.diff(xyz, 2, axis=0), axis=2).mean() for xyz in (smooth_xyz, raw_xyz)]
    assert restless[0] < 0.95 * restless[1]
    assert shown.score().hands[0].error_mm < raw.score().hands[0].error_mm + 2


def test_the_same_again(shown: Take, predictor: Predictor) -> None:
    """A second run gives the same hands bit for bit."""
    for one, other in zip(again(predictor, shown), shown.reported):
        assert one.lost == other.lost and len(one.hands) == len(other.hands)
        for own, same in zip(one.hands, other.hands):
            for field in (field for field in dataclasses.fields(TrackedHand) if field.name != "other"):
                np.testing.assert_equal(getattr(own, field.name), getattr(same, field.name))


def test_surface(shown: Take, leaving: Take, predictor: Predictor) -> None:
    """With ``surface`` the capsules surround the joints, for left hands as well."""
    for take in (shown, leaving):
        hand = again(predictor, take, 2, surface=True)[-1].hands[0]
        assert hand.capsules is not None
        ends = np.concatenate([hand.capsules.a[0], hand.capsules.b[0]])
        nearest = np.linalg.norm(hand.xyz[:, None] - ends, axis=2).min(axis=1)
        assert np.median(nearest) < 15


def test_it_goes_frame_by_frame(shown: Take, predictor: Predictor) -> None:
    """The next frame is read only after the previous one has been reported."""
    taken: list[int] = []

    def frames() -> Iterator[DepthFrame]:
        for frame in shown.frames:
            taken.append(frame.number)
            yield frame

    reported = Tracker(predictor).follow(frames())
    assert next(reported).number == 0 and taken == [0]
    assert next(reported).number == 1 and taken == [0, 1]


# --------------------------------------------------------------------------------------- lost and found


def test_a_hand_that_leaves_and_returns(leaving: Take) -> None:
    """The hand is reported as lost, with reason and time, and returns with the same id and side."""
    scores = leaving.score()
    hand = scores.hands[0]
    away = [true.number for true in leaving.truth if [lost.reason for lost in true.lost] == [LEFT]]
    told = [leaving.reported[number].lost for number in away]
    assert len(told) > 5 and sum(bool(lost) for lost in told) >= len(told) - 3
    assert sum(lost[0].reason.startswith(LEFT) for lost in told if lost) >= len(told) - 5
    assert scores.found > 0.75 and hand.id_switches == 0 and hand.wrong_side <= 3 and hand.error_mm < 20
    gone = [frame.lost[0] for frame in leaving.reported if frame.lost]
    assert gone[0].reason.startswith(LEFT) and {(lost.id, lost.hand) for lost in gone} == {(0, "left")}
    assert {hand.id for frame in leaving.reported for hand in frame.hands} == {0}
    assert leaving.reported[-1].hands and not leaving.reported[-1].lost


def test_nothing_lost_is_repeated(leaving: Take) -> None:
    """A hand is either reported or lost, and ``since`` is constant until it is found again."""
    since = None
    for frame in leaving.reported:
        assert len(frame.hands) + len(frame.lost) == 1
        if frame.hands:
            since = frame.time
        else:
            assert frame.lost[0].since == since and frame.lost[0].reason


def test_what_becomes_of_a_hand(shown: Take, begun: Callable[[], Tracker]) -> None:
    """The reason is an empty frame, then the wall at the hand's place."""
    tracker, step = begun(), 1 / RATE
    empty, wall = np.zeros((240, 320), np.float32), np.full((240, 320), 1500, np.float32)
    reported = [tracker.step(DepthFrame(6, 6 * step, empty)), tracker.step(DepthFrame(7, 7 * step, wall))]
    assert [frame.hands for frame in reported] == [(), ()]
    assert reported[0].lost == (LostHand(0, reported[0].lost[0].hand, 5 * step, "no depth in this frame"),)
    assert reported[1].lost[0].reason.startswith("only background at its last position")


def test_what_does_not_look_like_a_hand_is_dropped(
    shown: Take, begun: Callable[[], Tracker], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pose whose confidence by the frame is low is none, and the hand is lost when its credit is used up."""
    tracker = begun()
    (track,) = tracker.tracks
    monkeypatch.setattr(tracker.finder, "hands", lambda *what: [])

    def doubtful(hands: list[Hand], readings: np.ndarray | None) -> list[Hand]:
        return [dataclasses.replace(hand, error_mm=60.0, confidence=0.2) for hand in hands]

    monkeypatch.setattr(estimator, "judge", doubtful)
    assert tracker.step(shown.frames[6]).lost[0].reason == f"{NO_HAND} (confidence 20%)"
    for frame in shown.frames[7:24]:
        reported = tracker.step(frame)
        assert not reported.hands and reported.lost[0].reason
        assert track.is_tracked == (track.credit > 0)
    assert not track.is_tracked


def test_after_a_gap_in_time(shown: Take, begun: Callable[[], Tracker]) -> None:
    """A hand that is not at its place after a gap is lost at once, until it is found again."""
    tracker = begun()
    reported = tracker.step(DepthFrame(99, 9.0, np.full((240, 320), 1500, np.float32)))
    assert not reported.hands and not tracker.tracks
    assert reported.lost[0].reason.startswith("only background at its last position")
    for n in range(20):
        reported = tracker.step(DepthFrame(100 + n, 9.1 + n / RATE, shown.frames[n].depth))
        if reported.hands:
            break
    assert [hand.id for hand in reported.hands] == [0] and not reported.lost


def test_a_place_out_of_sight(shown: Take, predictor: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no crop can be taken, no hand is followed; the finder's is reported."""
    tracker = Tracker(predictor)
    monkeypatch.setattr(tracker.estimator, "estimate", lambda depth, regions, *others: [None] * len(regions))
    frame = tracker.step(shown.frames[0])
    assert not frame.hands and not frame.lost and [hand.id for hand in frame.present] == [0]


def what_the_finder_says(monkeypatch: pytest.MonkeyPatch, tracker: Tracker, *places: tuple[float, ...]) -> None:
    """It sees a hand at each place (x, y, z, presence)."""
    hands = [FoundHand(presence, np.array(place), 0.5, np.ones((240, 320), bool)) for *place, presence in places]
    monkeypatch.setattr(tracker, "finder", SimpleNamespace(hands=lambda *what: hands))


def test_what_only_the_finder_takes_for_a_hand(predictor: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is present without joints where the finder sees it, and is gone when the finder no longer sees it."""
    tracker = Tracker(predictor)
    what_the_finder_says(monkeypatch, tracker, (0.0, 60, 1400, 0.7))
    image = np.full((240, 320), 1380, np.float32)
    for n in range(12):
        found = tracker.step(DepthFrame(n, n / RATE, image))
        [present] = found.present
        assert not found.hands and present.place == (0, 60, 1400) and present.presence == pytest.approx(0.7)
    what_the_finder_says(monkeypatch, tracker)
    for n in range(12, 17):
        found = tracker.step(DepthFrame(n, n / RATE, image))
    assert found == TrackedFrame(16, 16 / RATE, (), ()) and not tracker.tracks


def test_a_place_with_a_higher_presence_replaces_one_without_a_pose(
    predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker, image = Tracker(predictor, hands=1), np.full((240, 320), 1380, np.float32)
    what_the_finder_says(monkeypatch, tracker, (0.0, 60, 1400, 0.4))
    tracker.step(DepthFrame(0, 0.0, image))
    what_the_finder_says(monkeypatch, tracker, (250.0, 60, 1400, 0.6), (0.0, 60, 1400, 0.4))
    assert [one.place for one in tracker.step(DepthFrame(1, 1.0, image)).present] == [(250, 60, 1400)]


def test_a_hand_that_is_more_present_takes_the_place_of_a_doubtful_one(
    shown: Take, predictor: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = Tracker(predictor, hands=1)
    tracker.step(shown.frames[0])
    [track] = tracker.tracks
    monkeypatch.setattr(HandTrack, "evidence", 0.5)
    monkeypatch.setattr("handpose.tracking.tracker.SURE", 2.0)
    what_the_finder_says(monkeypatch, tracker, (250.0, 60, 1400, 0.4))
    assert tracker.step(shown.frames[0]._replace(time=1.0)).hands and track.is_tracked
    what_the_finder_says(monkeypatch, tracker, (250.0, 60, 1400, 0.9))
    reported = tracker.step(shown.frames[0]._replace(time=2.0))
    assert [lost.reason for lost in reported.lost] == ["another hand is more present"] and not track.is_tracked
    assert [one.place for one in reported.present] == [(250, 60, 1400)]


# ------------------------------------------------------------------------------------------ many and none


def test_two_hands(two: Take) -> None:
    """Each hand has its own id and the right side."""
    scores = two.score()
    assert scores.found > 0.6 and scores.invented == 0
    assert not any(hand.id_switches for hand in scores.hands.values())
    last = two.reported[-1].hands
    assert [hand.id for hand in last] == [0, 1] and {hand.hand for hand in last} == {"right", "left"}
    for hand in last:
        true = next(own for own in two.truth[-1].hands if own.hand == hand.hand)
        assert np.linalg.norm(hand.xyz - true.xyz, axis=1).mean() < 25


@pytest.mark.parametrize("apart", [0.2, 0.5])
def test_both_hands_are_found_at_once(two: Take, predictor: Predictor, apart: float) -> None:
    """Both hands are found in the first frame, and in every frame after a long gap."""
    first = next(n for n, frame in enumerate(two.truth) if len(frame.hands) == 2 and len(two.reported[n].hands) == 2)
    frames = [frame._replace(time=apart * n) for n, frame in enumerate(two.frames[first : first + 6 : 2])]
    for reported in Tracker(predictor).follow(frames):
        assert {hand.hand for hand in reported.hands} == {"right", "left"}


def test_no_more_hands_than_are_wanted(two: Take, predictor: Predictor) -> None:
    """Only one of two hands is reported, always the same."""
    reported = again(predictor, two, 5, hands=1)
    assert {len(frame.hands) for frame in reported[1:]} == {1} and not any(frame.lost for frame in reported)
    places = np.array([frame.hands[0].origin_mm for frame in reported[1:]])
    assert np.ptp(places, axis=0).max() < 60


def test_one_hand_is_not_two(shown: Take, begun: Callable[[], Tracker]) -> None:
    """If two tracks come to the same place, one continues and the other is lost."""
    tracker = begun()
    last = tracker.tracks[0].best.estimate
    tracker.known[1] = HandTrack(tracker.estimator, [last], shown.frames[5].time)
    tracker.known[1].identify(1)
    reported = tracker.step(shown.frames[6])
    assert len(reported.hands) == len(reported.lost) == 1 and reported.hands[0].id != reported.lost[0].id
    assert reported.lost[0].reason == "another hand is tracked at its position"
    assert [hand.id for hand in tracker.step(shown.frames[7]).hands] == [reported.hands[0].id]


def test_nobody(predictor: Predictor) -> None:
    """An empty image, or a wall, gives neither hands nor lost hands."""
    tracker = Tracker(predictor)
    for n, depth in enumerate((0, 0, 1200, 1200, 1200, 3000)):
        image = np.full((240, 320), depth, np.float32)
        assert tracker.step(DepthFrame(n, n / RATE, image)) == TrackedFrame(n, n / RATE, (), ())


# ----------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize("hands", [1, 2])
def test_a_frame_of_another_size(shown: Take, begun: Callable[[], Tracker], predictor: Predictor, hands: int) -> None:
    """A frame of another size raises an error, also while the maximum number of hands is tracked."""
    tracker = begun() if hands == 2 else Tracker(predictor, hands=hands)
    tracker.step(shown.frames[6])
    assert len(tracker.tracks) == 1
    other = DepthFrame(7, 7 / RATE, np.full((480, 640), 700, np.float32))
    with pytest.raises(DataError, match=r"depth image of shape \(480, 640\), expected \(240, 320\) of camera 'icvl'"):
        tracker.step(other)


def test_times_that_do_not_ascend(shown: Take, begun: Callable[[], Tracker]) -> None:
    """Times that do not ascend raise an error, because velocities would be undefined."""
    tracker = begun()
    for time in (5 / RATE, 0.0, float("nan")):
        with pytest.raises(DataError, match=r"frame 9 is of \S+ s, after one of 0.333333 s; times must ascend"):
            tracker.step(DepthFrame(9, time, shown.frames[6].depth))
    assert tracker.step(shown.frames[6]).hands


@pytest.mark.parametrize("hands", [0, -1, 1.5, True])
def test_numbers_of_hands(predictor: Predictor, hands: int) -> None:
    """An invalid number of hands raises an error."""
    with pytest.raises(NetlibError, match=f"hands={hands}; expected a whole number from 1 to 100"):
        Tracker(predictor, hands=hands)


def test_another_unit(shown: Take, begun: Callable[[], Tracker], predictor: Predictor) -> None:
    """Another unit raises an error at the first frame with readings; a speck in a later frame does not."""
    for factor in (0.001, -1):
        tracker = Tracker(predictor)
        tracker.step(DepthFrame(0, 0.0, np.zeros((240, 320), np.float32)))
        with pytest.raises(UnitError, match="expected mm"):
            tracker.step(DepthFrame(1, 0.1, shown.frames[0].depth * np.float32(factor)))
    tracker = begun()
    tracker.step(DepthFrame(6, 6 / RATE, np.eye(240, 320, dtype=np.float32)))


def test_masked_frames(shown: Take, predictor: Predictor) -> None:
    """Masked pixels have no reading."""
    tracker = Tracker(predictor)
    hidden = np.ma.array(shown.frames[0].depth, mask=True)
    assert tracker.step(DepthFrame(0, 0.0, hidden)) == TrackedFrame(0, 0.0, (), ())


def test_predictors_of_other_kinds() -> None:
    """A predictor without a fit raises an error."""
    with pytest.raises(NetlibError, match="a tracker needs a predictor with a fit and a finder"):
        Tracker(load_predictor(NYU, fit="no", hand="right"))


def test_in_five_lines(shown: Take) -> None:
    """The tracker is loaded with the packaged weights and options."""
    tracker = load_tracker(shown.recording.camera, hands=1, smooth=False)
    header = tracker.header(shown.recording.name)
    assert (header.source, header.camera, header.unit_mm, header.smoothed) == (shown.recording.name, ICVL, 150, False)
    for frame in tracker.follow(shown.frames[:2]):
        assert [hand.xyz.shape for hand in frame.hands] == [(31, 3)] and not frame.lost
