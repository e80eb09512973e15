"""A body, what sees it, and short recordings that were tracked once for many tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from handpose.facts.cameras import ICVL
from handpose.fitting.depth.body import FleshModel
from handpose.predicting.packaged import load_predictor
from handpose.predicting.predictor import Predictor
from handpose.recordings.recording import DepthFrame
from handpose.synthetic.acts import Act
from handpose.synthetic.recordings import SyntheticRecording
from handpose.synthetic.scripts import Role, Script
from handpose.tracking.tracker import Tracker
from handpose.tracks.track import TrackedFrame
from layers.hand import skeleton

RATE = 15.0


@dataclass
class Take:
    """A recording, and what a tracker told of it: frames, and after each the sizes that it knew, by id."""

    recording: SyntheticRecording
    tracker: Tracker
    frames: list[DepthFrame]
    told: list[TrackedFrame] = field(default_factory=list)
    sizes: list[dict[int, float | None]] = field(default_factory=list)
    truth: list[TrackedFrame] = field(default_factory=list)


def play(predictor: Predictor, script: Script, seed: int, **options: object) -> Take:
    """Track a script, which is to be before ICVL's camera."""
    recording = SyntheticRecording(script, ICVL, rate=RATE, seed=seed)
    take = Take(recording, Tracker(predictor, **options), list(recording), truth=list(recording.truths()))  # type: ignore[arg-type]
    for frame in take.frames:
        take.told.append(take.tracker.step(frame))
        take.sizes.append({id: known.size for id, known in take.tracker.known.items()})
    return take


@pytest.fixture(scope="session")
def model() -> FleshModel:
    """The packaged hand in NYU's cube."""
    return FleshModel(skeleton.load(), 150.0)


@pytest.fixture(scope="session")
def predictor() -> Predictor:
    """The packaged one for ICVL's camera, the smallest."""
    return load_predictor(ICVL, fit="fast")


@pytest.fixture(scope="session")
def shown(predictor: Predictor) -> Take:
    """A right hand that shows gestures for three seconds."""
    return play(predictor, Script(3, (Role("right", (Act("gestures", 3),)),)), 2)


@pytest.fixture(scope="session")
def leaving(predictor: Predictor) -> Take:
    """A left hand that leaves and returns."""
    acts = (Act("rest", 0.6), Act("away", 2.2), Act("rest", 0.8))
    return play(predictor, Script(3.4, (Role("left", acts),)), 3)


@pytest.fixture(scope="session")
def two(predictor: Predictor) -> Take:
    """Both hands of a person, at rest."""
    return play(predictor, Script(1, (Role("right", (Act("rest", 1),)), Role("left", (Act("rest", 1),)))), 2)
