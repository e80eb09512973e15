"""A tracked hand that something nearer covers, or of which nothing is read: no confident pose, and the right reason"""

from __future__ import annotations

import csv
import functools
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from handpose.body.sides import Side
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import ICVL
from handpose.frames.recording import DepthFrame
from handpose.output.live.messages import Messages
from handpose.output.tracks.writing import open_writer
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from handpose.tracking.track import HIDDEN, TrackedFrame, TrackedHand
from handpose.tracking.tracker import Tracker
from tests.handpose.tracking.conftest import RATE, Take, copied, played

BEGUN = 6  # frames before the covering
DOUBTFUL = 0.3  # maximum confidence of a pose of a covered hand
NEAR = (30.0, 200.0, 0.8)  # depths of what covers the hand: mm, or parts of the hand's
FITS = ("fast", "accurate")  # one after the other: both with every value take twice the time
REASON = f"{HIDDEN} by a nearer object"


def with_fits(names: str, values: Iterable[object]) -> pytest.MarkDecorator:
    """Parametrize a test by these values, and in turn by the tracker's fits."""
    cases = [(fit, *(value if isinstance(value, tuple) else (value,))) for fit, value in zip(cycle(FITS), values)]
    return pytest.mark.parametrize(f"begun,{names}", cases, indirect=["begun"])


@pytest.fixture(scope="module")
def resting() -> Take:
    """A right hand at rest."""
    return played(Script(0.8, {"right": (Act("rest", 1),)}), 5)


@pytest.fixture(scope="module")
def trackers(resting: Take) -> Callable[[str], Tracker]:
    """``trackers(fit)``: a tracker of that hand with this fit, made once."""

    @functools.cache
    def tracker(fit: str) -> Tracker:
        made = Tracker(load_predictor(ICVL, fit=fit), min_confidence=0)
        for frame in resting.frames[:BEGUN]:
            reported = made.step(frame)
        assert reported.hands[0].confidence > 0.5
        return made

    return tracker


@pytest.fixture
def begun(trackers: Callable[[str], Tracker], request: pytest.FixtureRequest) -> Tracker:
    """A tracker of that hand with the test's fit, which every test copies."""
    return trackers(getattr(request, "param", "fast"))


def own_pixels(take: Take, number: int) -> NDArray[np.bool_]:
    """The pixels of the hand and of a part of its arm."""
    depth, hand = take.frames[number].depth, take.truth[number].hands[0]
    columns, rows = np.arange(ICVL.width), np.arange(ICVL.height)[:, None]
    u, v, d = hand.center_uvd
    reach = 110 * ICVL.fx / d
    return np.asarray((abs(columns - u) < reach) & (abs(rows - v) < reach) & (abs(depth - d) < 130))


def covered(take: Take, number: int, share: float, value: float) -> DepthFrame:
    """A frame in which this share of the hand's pixels, from the left, has another reading; with 2 the whole view."""
    own, frame = own_pixels(take, number), take.frames[number]
    columns = np.argwhere(own)[:, 1]
    last = np.quantile(columns, min(share, 1))
    where = own & (np.arange(ICVL.width) <= last) if share <= 1 else np.ones_like(own)
    near = value if value >= 1 or value == 0 else value * take.truth[number].hands[0].center_uvd[2]
    return frame._replace(depth=np.where(where, np.float32(near), frame.depth))


def after(tracker: Tracker, take: Take, share: float, value: float, frames: int = 2) -> Iterator[TrackedFrame]:
    """Frames that are covered like this: the last one is reported without smoothing."""
    own = copied(tracker)
    for number in range(BEGUN, BEGUN + frames):
        own.smooth = number < BEGUN + frames - 1
        yield own.step(covered(take, number, share, value))


@with_fits("value", NEAR)
def test_something_nearer(begun: Tracker, resting: Take, value: float) -> None:
    """From half of the hand to the whole view: no confident pose, and the reason; then the hand is tracked again."""
    for share in (0.5, 0.9, 2.0):
        for reported in after(begun, resting, share, value):
            assert all(hand.confidence <= DOUBTFUL for hand in reported.hands)
            assert [lost.reason for lost in reported.lost if lost.id == 0] == [REASON] * (not reported.hands)
    again = copied(begun)
    again.step(covered(resting, BEGUN, 1.0, value))
    assert again.step(resting.frames[BEGUN + 1]).hands[0].id == 0


@with_fits("value", NEAR)
def test_a_part(begun: Tracker, resting: Take, value: float) -> None:
    """A hand that is covered a little is tracked, or lost for this reason; the more is covered, the less confident."""
    confidences = []
    for share in (0.0, 0.1, 0.3):
        for reported in after(begun, resting, share, value):
            confidences.append(max((hand.confidence for hand in reported.hands), default=0.0))
            assert all(lost.reason == REASON for lost in reported.lost)
    assert min(confidences[:4]) > DOUBTFUL and confidences[4] < confidences[0] + 0.01


@with_fits("value", [30.0, 200.0])
def test_the_pose_of_a_part(begun: Tracker, resting: Take, value: float) -> None:
    """The visible part of a hand keeps its pose: the fit does not move the hidden part into sight."""
    own, errors = copied(begun), []
    (whole,) = copied(begun).step(covered(resting, BEGUN, 0.0, value)).hands
    for number in range(BEGUN, BEGUN + 5):
        for hand in own.step(covered(resting, number, 0.35, value)).hands:
            errors.append(np.linalg.norm(hand.xyz - resting.truth[number].hands[0].xyz, axis=1).mean())
            assert hand.id == 0 and hand.confidence < whole.confidence
    assert len(errors) >= 4 and max(errors) < 20


def moving(side: Side, velocity: tuple[float, float, float], seed: int) -> Take:
    """A hand that starts to move at BEGUN, at once with this velocity in m/s, for five frames at 30 per second."""
    script = Script((BEGUN + 7) / 30, {side: (Act("rest", 1),)})
    recording = SyntheticRecording(script, ICVL, rate=30, seed=seed)
    (movement,) = recording.movements
    at_rest = movement.pose_at

    def pose_at(time: float) -> TrackedHand:
        pose, way = at_rest(time), 1000 * np.array(velocity) * np.clip(time - (BEGUN - 0.5) / 30, 0, 5 / 30)
        capsules = pose.capsules._replace(a=pose.capsules.a + way, b=pose.capsules.b + way)
        return replace(pose, xyz=pose.xyz + way, capsules=capsules)

    movement.pose_at = pose_at
    return Take(recording, list(recording), list(recording.truths()))


@pytest.mark.parametrize(
    ("side", "velocity", "seed"),
    [
        ("right", (0, 0, -1.5), 5),
        ("right", (2, 0, 0), 5),
        ("left", (2, 0, 0), 6),
        ("left", (2, 0, 1), 5),
    ],
)
def test_a_hand_that_moves_fast_is_not_covered(
    predictor: Predictor, side: Side, velocity: tuple[float, float, float], seed: int
) -> None:
    """A hand that pushes towards the camera, or moves aside, is followed from the first frame on."""
    take, tracker = moving(side, velocity, seed), Tracker(predictor)
    for frame, truth in zip(take.frames, take.truth):
        (hand,) = tracker.step(frame).hands
        assert np.linalg.norm(hand.xyz - truth.hands[0].xyz, axis=1).mean() < 25


@with_fits("share", [0.6, 1.0])
def test_no_readings(begun: Tracker, resting: Take, share: float) -> None:
    """Without readings of the hand no confident pose is reported, and the reason."""
    for value in (0.0, np.nan):
        for reported in after(begun, resting, share, value):
            assert all(hand.confidence <= DOUBTFUL for hand in reported.hands)
            assert reported.hands or reported.lost[0].reason.startswith(("no depth", "only background"))


@with_fits("share,value", [(0.35, 0.0), (0.35, np.nan), (0.5, 0.0), (0.75, 0.0)])
def test_the_pose_of_a_part_that_is_read(begun: Tracker, resting: Take, share: float, value: float) -> None:
    """What is not read of a hand is unknown, not empty: the rest keeps its pose, and half of it is no sure pose."""
    for reported in after(begun, resting, share, value, 5):
        assert reported.hands or share > 0.3
        for hand in reported.hands:
            assert np.linalg.norm(hand.xyz - resting.truth[reported.number].hands[0].xyz, axis=1).mean() < 20
            assert share < 0.5 or hand.confidence <= DOUBTFUL


@with_fits("value", [250.0, 600.0])
def test_frames_of_one_value(begun: Tracker, resting: Take, value: float) -> None:
    """A lens that is covered for a second shows no hand, whether or not one was tracked before."""
    for tracker in (copied(begun), Tracker(begun.predictor)):
        for n in range(int(RATE)):
            plain = np.full((ICVL.height, ICVL.width), value, np.float32)
            reported = tracker.step(DepthFrame(BEGUN + n, (BEGUN + n) / RATE, plain))
            assert not reported.hands


def test_all_outputs(begun: Tracker, resting: Take, tmp_path: Path) -> None:
    """Files, and the messages sent by WebSocket, have no pose of a covered hand, and the reason."""
    header = begun.header("a recording")
    frames = [*after(begun, resting, 2.0, 0.6, 3)]
    for name in ("t.json", "t.csv"):
        with open_writer(tmp_path / name, header) as writer:
            for frame in frames:
                writer.write(frame)
    document = json.loads((tmp_path / "t.json").read_text())
    messages = Messages(header)
    records = [messages.record(frame) for frame in frames]
    sent = [json.loads(messages.line(record)) for record in records]
    for written in (document["frames"], sent):
        assert [frame["hands"] for frame in written] == [[]] * 3
        assert [lost["reason"] for frame in written for lost in frame["lost"]] == [REASON] * 3
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [(row["lost"], row["confidence"]) for row in rows] == [(REASON, "")] * 3
