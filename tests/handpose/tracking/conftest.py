"""A body, its predictor, and short recordings that are tracked once for many tests."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import ICVL
from handpose.frames.recording import DepthFrame
from handpose.scoring.tracks import TrackScores, score
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from handpose.tracking.settings import SizeSettings, TrackSettings
from handpose.tracking.track import TrackedFrame, TrackedHand
from handpose.tracking.tracker import Tracker

RATE = 15.0


@dataclass
class Take:
    """A recording with its truth and its tracked frames."""

    recording: SyntheticRecording
    frames: list[DepthFrame]
    truth: list[TrackedFrame]
    tracker: Tracker | None = None
    reported: list[TrackedFrame] = field(default_factory=list)

    def score(self) -> TrackScores:
        """The scores of the tracked frames."""
        assert self.tracker is not None
        return score(self.tracker.header("a recording"), self.reported, self.truth)


def played(script: Script, seed: int) -> Take:
    """A recording of a script for ICVL's camera, not tracked yet."""
    recording = SyntheticRecording(script, ICVL, rate=RATE, seed=seed)
    return Take(recording, list(recording), list(recording.truths()))


def tracked(predictor: Predictor, take: Take, **options: object) -> Take:
    """The same take, with all hands that are followed.

    Sizes are determined from fewer frames than usual, because recordings are short.
    """
    settings = TrackSettings(size=SizeSettings(poses=12))
    tracker = Tracker(predictor, min_confidence=0, settings=settings, **options)  # type: ignore[arg-type]
    return replace(take, tracker=tracker, reported=[*tracker.follow(take.frames)])


def frames_of(
    *frames: tuple[TrackedHand, ...], step: float = 1.0, first: float = 0.0
) -> list[TrackedFrame]:
    """Frames with these hands, one every ``step`` seconds from ``first`` on."""
    return [TrackedFrame(n, first + n * step, hands) for n, hands in enumerate(frames)]


def error_of(hand: TrackedHand, truth: TrackedFrame) -> float:
    """The mean error in mm of a hand's joints from those of the true hand of its side."""
    (true,) = (own for own in truth.hands if own.hand == hand.hand)
    return float(np.linalg.norm(hand.xyz - true.xyz, axis=1).mean())


def copied(tracker: Tracker) -> Tracker:
    """A tracker in the same state, which shares what tracking does not change."""
    models = [track.best.estimate.model for track in tracker.tracks]
    shared = (tracker.predictor, tracker.estimator, tracker.finder, *models)
    return copy.deepcopy(tracker, {id(one): one for one in shared})


@pytest.fixture(scope="session")
def predictor() -> Predictor:
    """The packaged predictor for ICVL's camera, the smallest one."""
    return load_predictor(ICVL, fit="fast")


@pytest.fixture(scope="session")
def shown(predictor: Predictor) -> Take:
    """A right hand that shows gestures for three seconds."""
    return tracked(predictor, played(Script(3, {"right": (Act("gestures", 3),)}), 2))


@pytest.fixture(scope="session")
def leaving(predictor: Predictor) -> Take:
    """A left hand that leaves the image and returns."""
    acts = (Act("rest", 0.6), Act("away", 1.4), Act("rest", 0.8))
    return tracked(predictor, played(Script(2.8, {"left": acts}), 3))


@pytest.fixture(scope="session")
def two(predictor: Predictor) -> Take:
    """Both hands of a person, at rest."""
    return tracked(
        predictor, played(Script(0.8, {"right": (Act("rest", 1),), "left": (Act("rest", 1),)}), 2)
    )
