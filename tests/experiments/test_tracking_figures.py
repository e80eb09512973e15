"""experiments/tracking_figures.py: a track compared with the truth and with single frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.tracking_figures import Alone, follow, summary
from handpose.estimate.packaged import load_predictor
from handpose.frames.cameras import ICVL
from handpose.frames.recording import DepthFrame
from handpose.sequences.recordings import SyntheticRecording
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.errors import NetlibError
from tests.support.tracked_hands import HEADER, tracked


class MadeRecording(SyntheticRecording):
    """A hand that moves 10 mm per frame and is absent in the last one."""

    def __init__(self) -> None:
        super().__init__("rest", HEADER.camera, rate=10, seconds=0.4)

    def frame(self, number: int) -> DepthFrame:
        """A frame without readings."""
        return DepthFrame(number, number / 10, np.zeros((120, 160), np.float32))

    def truth(self, number: int) -> TrackedFrame:
        """The moving hand, if present."""
        hands = (tracked(at=(10.0 * number, 0, 600)),) if number < 3 else ()
        return TrackedFrame(number, number / 10, hands)


class MadeTracker:
    """Returns the truth with an offset in mm; one frame is missed, and one has a hand where there is none."""

    def __init__(self, beside: float) -> None:
        self.beside = beside

    def header(self, source: str) -> TrackHeader:
        """The header of any track."""
        return HEADER

    def step(self, frame: DepthFrame) -> TrackedFrame:
        """The tracked hand of a frame."""
        there = tracked(at=(10.0 * frame.number, self.beside, 600), id=7)
        return TrackedFrame(frame.number, frame.time, () if frame.number == 1 else (there,))


def alone(depth: object, true: tuple[object, ...]) -> dict[int, np.ndarray]:
    """Finds all hands, with errors of 2 mm."""
    return {hand.id: np.full(len(hand.xyz), 2.0) for hand in true}


def test_a_track_beside_single_frames():
    """Errors are compared where both find the hand; hands found by only one of them are counted."""
    done = []
    found = follow(MadeRecording(), MadeTracker(3.0), alone, progress=done.append)
    assert (found.frames, found.invented, done) == (4, 1, [1, 1, 1, 1]) and found.seconds > 0
    (hand,) = found.hands
    assert (hand.off.shape, hand.same.shape, hand.looked, hand.seen) == ((2, 31), (2, 31), 3, 3)
    figures = summary(found.hands)
    assert figures["same"] == pytest.approx(3) and figures["alone"] == pytest.approx(2)
    assert figures["mean_14"] == pytest.approx(3) and figures["found"] == pytest.approx(2 / 3)
    assert (figures["missed"], figures["alone_found"], figures["jitter"]) == (1, 1, None)


def test_every_so_many_th_frame_alone():
    """With ``every=2``, frames 0 and 2 are detected alone; without a detector the figures are None."""
    (hand,) = follow(MadeRecording(), MadeTracker(3.0), alone, every=2).hands
    assert (hand.looked, len(hand.same), len(hand.off)) == (2, 2, 2)
    figures = summary(follow(MadeRecording(), MadeTracker(3.0)).hands)
    assert figures["alone"] is None and figures["alone_found"] is None


def test_several_hands_together():
    """Errors are averaged over frames, lags over hands; for bones the worst value counts."""
    (first,) = follow(MadeRecording(), MadeTracker(1.0)).hands
    (second,) = follow(MadeRecording(), MadeTracker(4.0)).hands
    scores = replace(second.scores, jitter_mm=0.6, rest_frames=10, lag_ms=30.0, bone_change_mm=(0.0, 2.0))
    second = second._replace(scores=scores, off=np.repeat(second.off, 2, axis=0))
    third = first._replace(scores=replace(first.scores, jitter_mm=0.2, rest_frames=10, lag_ms=10.0))
    figures = summary([first, second, third])
    assert figures["mean"] == pytest.approx((2 * 1 + 4 * 4 + 2 * 1) / 8)
    assert figures["jitter"] == pytest.approx(np.sqrt((0.36 + 0.04) / 2))
    assert (figures["lag"], figures["bone_change"]) == (20, 2)


def test_no_hand():
    """Without hands all means are None."""
    figures = summary([])
    assert figures["in_sight"] == 0 and figures["mean"] is None and figures["found"] is None


def test_single_frames_by_the_predictor():
    """A hand is found within 15 mm, and one at a wrong place is not found."""
    recording = SyntheticRecording("rest", ICVL, seconds=0.1, seed=3)
    right, left = (load_predictor(ICVL, hand=side, refine=0, fit="fast") for side in ("right", "left"))
    look, (hand,) = Alone(right, left), recording.truth(0).hands
    depth = recording.frame(0).depth
    assert look(depth, [hand])[0].mean() < 15
    assert look(depth, [replace(hand, center_uvd=np.array([-5000.0, 0, 600]))]) == {}
    assert look(depth, [replace(hand, xyz=hand.xyz + 200)]) == {}


def test_predictors_that_move_the_crop():
    """A predictor that moves its crop raises an error."""
    right = load_predictor(ICVL, hand="right", fit="fast")
    with pytest.raises(NetlibError, match="for right hands that moves its crop 3 times; expected one for right hands"):
        Alone(right, right)
