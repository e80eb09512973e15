"""handpose/body/gestures.py: the scores of one frame"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.gestures import GESTURES, NUMBERS, scores
from handpose.sequences.person import SHOWN
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand.kinematics import Kinematics
from netlib.blob import Array

SAMPLER = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR).but(pose=SHOWN))
SK = SAMPLER.skeleton


def joints(inputs: Array, unit_mm: float = 130.0) -> Array:
    """A right hand (K, 3) in mm."""
    return np.asarray(Kinematics(SK).joints(inputs[None])[0] * unit_mm)


@pytest.mark.parametrize("gesture", [pose.name for pose in SHOWN])
@pytest.mark.parametrize("unit_mm", [100.0, 160.0])
def test_each_gesture_is_its_own(gesture: str, unit_mm: float) -> None:
    """Shown poses are recognised for hands of any size and orientation, right and left."""
    inputs = SAMPLER.poses[gesture].copy()
    inputs[3:6] = (0.4, -1.1, 2.0)
    right = joints(inputs, unit_mm)
    for found in (scores(SK, "right", right), scores(SK, "left", right * [-1, 1, 1])):
        assert max(found, key=lambda name: found[name]) == gesture
        assert found[gesture] > 0.7 and sum(found.values()) <= 1 + 1e-9


def test_a_half_bent_hand_shows_none() -> None:
    """Fingers between straight and bent give no gesture a high score."""
    found = scores(SK, "right", joints((SAMPLER.poses["open"] + SAMPLER.poses["fist"]) / 2))
    assert max(found.values()) < 0.5


def test_numbers() -> None:
    """The gestures that are numbers range from 0 to 5."""
    assert set(NUMBERS) < set(GESTURES) and sorted(NUMBERS.values()) == [0, 1, 2, 3, 4, 5]
