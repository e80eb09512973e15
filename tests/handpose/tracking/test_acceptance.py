"""handpose/tracking/acceptance.py; what a tracker does with places is in test_tracker.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.estimate.predictor import Predictor
from handpose.tracking import pose_estimator
from handpose.tracking.tracker import Tracker
from tests.handpose.tracking.conftest import Take


def test_a_place_is_a_hand_if_its_pose_is_sure_in_the_frame(
    predictor: Predictor, shown: Take, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new hand must have the confidence with which it would be reported: by the whole frame, not by the fit."""
    acceptance = Tracker(predictor).acceptance
    depth, place = shown.frames[0].depth.astype(np.float32), shown.truth[0].hands[0].xyz.mean(axis=0)
    offer = acceptance.hands_at(depth, place)
    assert offer.estimates and not offer.reason
    monkeypatch.setattr(pose_estimator, "judge", lambda hands, depth: [replace(h, quality=(60.0, 0.29)) for h in hands])
    offer = acceptance.hands_at(depth, place)
    assert not offer.estimates and offer.reason == "the pose is uncertain (confidence 29%)"
