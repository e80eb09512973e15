"""handpose/tracking/hand_track.py: the motion of a body between frames"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.fit.body import CapsuleModel, WorldPose, world_pose
from handpose.tracking.hand_track import motion_between, moved

SEEDS = st.integers(0, 10**6)


def any_x(model: CapsuleModel, seed: int) -> np.ndarray:
    """Variables (V,) with the root's angles in all directions."""
    x = np.random.default_rng(seed).uniform(-1, 1, model.variables)
    x[model.root] *= 4
    return x


@given(seed=SEEDS, seconds=st.floats(0.01, 2))
def test_motion_leads_there(model: CapsuleModel, seed: int, seconds: float) -> None:
    """The motion leads from one pose to the other; half the time is half the way, and no time is no motion."""
    first, second = (world_pose(model, any_x(model, seed + i), np.zeros(3)) for i in range(2))
    motion = motion_between(first, second, seconds)
    there, half, stay = (moved(first, motion, part * seconds) for part in (1, 0.5, 0))
    for found, expected in ((there, second), (stay, first)):
        for one, other in zip(found, expected):
            np.testing.assert_allclose(one, other, atol=1e-4)
    np.testing.assert_allclose(half.place, (first.place + second.place) / 2)
    np.testing.assert_allclose(half.rotation @ first.rotation.T @ half.rotation, second.rotation, atol=1e-4)


def test_how_fast() -> None:
    """A quarter turn about y and 10 mm along x in half a second give the velocities worked out by hand."""
    first = WorldPose(np.zeros(3), np.eye(3), np.zeros(2))
    second = WorldPose(np.array([10.0, 0, 0]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.array([0, 0.1]))
    motion = motion_between(first, second, 0.5)
    np.testing.assert_allclose(motion.place, [20, 0, 0])
    np.testing.assert_allclose(motion.turn, [0, np.pi, 0], atol=1e-9)
    np.testing.assert_allclose(motion.others, [0, 0.2])
