"""A tracked hand that something nearer covers, or of which nothing is read: no confident pose that
is wrong, and the right reason
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from handpose.body.sides import Side
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import ICVL
from handpose.frames.recording import DepthFrame
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from handpose.tracking.reasons import NO_POSE
from handpose.tracking.track import HIDDEN, HandPose, TrackedFrame
from handpose.tracking.tracker import Tracker
from tests.handpose.tracking.conftest import Take, copied, error_of, played

BEGUN = 6  # frames before the covering
MAX_COVERED_CONFIDENCE = 0.3
NEAR = (30.0, 200.0, 0.8)  # depths of what covers the hand: mm, or relative to the hand's
WHOLE_VIEW = 2.0
REASON = f"{HIDDEN} by a nearer object"


@pytest.fixture(scope="module")
def resting() -> Take:
    """A right hand at rest."""
    return played(Script(0.8, {"right": (Act("rest", 1),)}), 5)


@pytest.fixture(scope="module", params=["fast", "accurate"])
def begun(resting: Take, request: pytest.FixtureRequest) -> Tracker:
    """A tracker of that hand with each fit, which every test copies."""
    tracker = Tracker(load_predictor(ICVL, fit=request.param), min_confidence=0)
    for frame in resting.frames[:BEGUN]:
        reported = tracker.step(frame)
    assert reported.hands[0].confidence > 0.5
    return tracker


def own_pixels(take: Take, number: int) -> NDArray[np.bool_]:
    """The pixels of the hand and of a part of its arm."""
    depth = take.frames[number].depth
    u, v, d = take.truth[number].hands[0].pose.center_uvd
    rows, columns = np.ogrid[: ICVL.height, : ICVL.width]
    reach = 110 * ICVL.fx / d
    in_square = (abs(columns - u) < reach) & (abs(rows - v) < reach)
    return np.asarray(in_square & (abs(depth - d) < 130))


def covered(take: Take, number: int, share: float, value: float) -> DepthFrame:
    """A frame in which this share of the hand's pixels, from the left, has another reading; with
    WHOLE_VIEW all pixels.

    value  the reading in mm; between 0 and 1, relative to the hand's depth
    """
    frame = take.frames[number]
    where = own_pixels(take, number)
    if share == WHOLE_VIEW:
        where[...] = True
    last = np.quantile(np.argwhere(where)[:, 1], min(share, 1))
    where &= np.arange(ICVL.width) <= last
    if 0 < value < 1:
        value *= take.truth[number].hands[0].pose.center_uvd[2]
    return frame._replace(depth=np.where(where, np.float32(value), frame.depth))


def after(
    tracker: Tracker, take: Take, share: float, value: float, frames: int = 2
) -> Iterator[TrackedFrame]:
    """Frames that are covered like this: the last one is reported without smoothing."""
    own = copied(tracker)
    for number in range(BEGUN, BEGUN + frames):
        own.smooth = number < BEGUN + frames - 1
        yield own.step(covered(take, number, share, value))


@pytest.mark.parametrize(
    ("value", "reasons"),
    [
        *((value, (REASON,)) for value in NEAR),
        *((value, ("no depth", "only background")) for value in (0.0, np.nan)),
    ],
)
def test_a_hand_covered_by_half_or_more_has_no_confident_pose_that_is_wrong(
    begun: Tracker, resting: Take, value: float, reasons: tuple[str, ...]
) -> None:
    """Without a pose it is present while the finder sees the rest; otherwise it is lost with the
    reason. Then it is tracked again.
    """
    # all pixels of a hand that come nearer by a fifth are another hand
    most = 0.9 if value == 0.8 else 1.0
    for share in (0.5, 0.6, 0.9, most, WHOLE_VIEW):
        for reported in after(begun, resting, share, value):
            for hand in reported.hands:
                error_mm = error_of(hand, resting.truth[reported.number])
                assert hand.confidence <= MAX_COVERED_CONFIDENCE or error_mm < 20
            [own] = [one for one in reported.every if one.id == 0]
            assert own.pose or own.reason.startswith(reasons if share >= 1 else NO_POSE)
            assert own.is_lost == (not own.pose and share >= 1)
    again = copied(begun)
    again.step(covered(resting, BEGUN, most, value))
    assert again.step(resting.frames[BEGUN + 1]).hands[0].id == 0


@pytest.mark.parametrize(
    ("value", "share", "least", "frames"),
    [
        # a hand that is covered a little is tracked
        *((value, 0.1, MAX_COVERED_CONFIDENCE, 5) for value in NEAR),
        *((value, 0.35, 0.0, 3) for value in NEAR),
        # of fourteen such takes, four keep the pose with 0.35
        *((value, 0.2, 0.0, 4) for value in (0.0, np.nan)),
        (0.0, 0.5, 0.0, 0),
        (0.0, 0.75, 0.0, 0),
    ],
)
def test_the_pose_of_a_part(
    begun: Tracker, resting: Take, value: float, share: float, least: float, frames: int
) -> None:
    """What is covered or not read is unknown, not empty: the rest keeps its pose, or is present
    without one.
    """
    (whole,) = next(after(begun, resting, 0.0, value)).hands
    reported = list(after(begun, resting, share, value, 5))
    assert sum(len(frame.hands) for frame in reported) >= frames
    for frame in reported:
        assert not frame.lost
        for hand in frame.hands:
            error_mm = error_of(hand, resting.truth[frame.number])
            assert error_mm < (20 if share < 0.75 else 35)
            assert least < hand.confidence < whole.confidence + 0.01 and hand.id == 0


def moving(side: Side, velocity: tuple[float, float, float], seed: int) -> Take:
    """A hand that starts to move at BEGUN, at once with this velocity in m/s, for five frames at
    30 per second.
    """
    script = Script((BEGUN + 7) / 30, {side: (Act("rest", 1),)})
    recording = SyntheticRecording(script, ICVL, rate=30, seed=seed)
    (movement,) = recording.movements
    at_rest = movement.pose_at

    def pose_at(time: float) -> HandPose:
        pose = at_rest(time)
        moved_s = np.clip(time - (BEGUN - 0.5) / 30, 0, 5 / 30)
        way = 1000 * np.array(velocity) * moved_s
        surface = pose.capsules._replace(a=pose.capsules.a + way, b=pose.capsules.b + way)
        return replace(pose, xyz=pose.xyz + way, surface=lambda: surface)

    vars(movement)["pose_at"] = pose_at
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
    """A hand that pushes towards the camera, or moves aside, is followed from the
    first frame on.
    """
    take, tracker = moving(side, velocity, seed), Tracker(predictor)
    for frame, truth in zip(take.frames, take.truth):
        (hand,) = tracker.step(frame).hands
        assert error_of(hand, truth) < 25
