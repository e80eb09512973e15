"""handpose/tracking/acceptance.py; what a tracker does with places is in test_tracker.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.estimate.hand import Hand
from handpose.estimate.predictor import Predictor
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
    judged = Hand.judged
    monkeypatch.setattr(Hand, "judged", lambda self, readings: replace(judged(self, readings), quality=(60.0, 0.29)))
    offer = acceptance.hands_at(depth, place)
    assert not offer.estimates and offer.reason == "the pose is uncertain (confidence 29%)"


def test_a_flat_object_is_no_hand(predictor: Predictor, shown: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    """What network and fit take for a hand is refused, new or tracked, if its readings are in one plane."""
    acceptance = Tracker(predictor).acceptance
    depth, place = shown.frames[0].depth.astype(np.float32), shown.truth[0].hands[0].xyz.mean(axis=0)
    (hand, *_) = acceptance.hands_at(depth, place).estimates
    assert not acceptance.doubt(depth, hand)
    monkeypatch.setattr(acceptance.estimator, "share_in_a_plane", lambda depth, hand: 0.8)
    assert acceptance.doubt(depth, hand) == "the object there does not look like a hand (it is flat)"
    assert not acceptance.hands_at(depth, place).estimates
