"""handpose/tracking/track.py: the hands of a frame"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.gestures import GestureReader
from handpose.body.joint_formats.angles import anatomical_angles
from handpose.body.sides import SIDES, Side
from handpose.tracking.track import TrackedFrame
from tests.support.tracked_hands import HEADER, lost, present, tracked


def test_the_hands_of_a_frame() -> None:
    """Each is in one of three lists, by its id."""
    first, second = tracked(id=0), tracked("left", id=3)
    there, gone = present(1, 0.5, 0.1), lost(2)
    frame = TrackedFrame(0, 0.0, (first, there, gone, second))
    assert frame.hands == (first, second) and frame.present == (there,) and frame.lost == (gone,)


@pytest.mark.parametrize("side", SIDES)
def test_what_a_pose_shows_is_computed_once(side: Side) -> None:
    pose = tracked(side).pose
    assert pose.angles is pose.angles and pose.capsules is pose.capsules
    assert pose.angles == anatomical_angles(HEADER.skeleton, side, pose.xyz)


def test_the_gestures_of_a_frame() -> None:
    """Hands without a pose have none; gestures last from frame to frame."""
    reader, same = (GestureReader(HEADER.skeleton) for _ in range(2))
    for time in (0.0, 0.1):
        frame = TrackedFrame(0, time, (tracked(id=4), lost(5))).with_gestures(reader)
        posed, gone = frame.every
        assert posed.gesture == same.read(4, "right", posed.xyz, time) and gone.gesture is None
        assert posed.gesture.name == "open"


def test_a_hand_without_its_pose() -> None:
    hand = tracked(confidence=0.2).without_pose(None, np.array([1.0, 2, 3]), "covered")
    assert hand.pose is None and hand.other is None and hand.known_side is None
    assert (hand.place, hand.reason, hand.confidence) == ((1, 2, 3), "covered", 0.2)
