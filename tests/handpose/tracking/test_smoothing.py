"""handpose/tracking/smoothing.py: a trembling hand and a moving one"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.body import CapsuleModel, crop_variables, world_pose
from handpose.tracking.smoothing import PoseFilter

TIMES = np.arange(90) / 30
CENTER = np.array([20.0, -30, 700])


def smoothed(model: CapsuleModel, poses: np.ndarray) -> np.ndarray:
    """Smoothed joints (N, K, 3) in mm, from variables (N, V)."""
    one = PoseFilter()
    found = [
        crop_variables(model, one(world_pose(model, x, CENTER), float(time)), CENTER) for x, time in zip(poses, TIMES)
    ]
    return model.joints(np.array(found))


def bones(model: CapsuleModel, joints: np.ndarray) -> np.ndarray:
    """Bone lengths (N, K - 1)."""
    child = np.flatnonzero(model.skeleton.parents >= 0)
    return np.linalg.norm(joints[:, child] - joints[:, model.skeleton.parents[child]], axis=2)


@pytest.fixture
def trembling(model: CapsuleModel) -> np.ndarray:
    """Variables (90, V) of a hand at rest, with noise of half a millimetre and 0.004 radians, and a constant size."""
    off = np.random.default_rng(0).normal(0, 0.004, (len(TIMES), model.variables))
    off[:, :3] *= 0.5 / (150 * 0.004)
    off[:, -2:] = 0
    return off + np.random.default_rng(1).uniform(0, 0.3, model.variables)


def test_a_trembling_hand_becomes_steady(model: CapsuleModel, trembling: np.ndarray) -> None:
    """The deviation is halved at least, and the first pose is unchanged."""
    raw, found = model.joints(trembling), smoothed(model, trembling)
    np.testing.assert_allclose(found[0], raw[0], atol=1e-6)
    assert found[15:].std(axis=0).max() < 0.5 * raw.std(axis=0).max()
    np.testing.assert_allclose(found[15:].mean(axis=0), raw.mean(axis=0), atol=1)


def test_bones_keep_their_length(model: CapsuleModel, trembling: np.ndarray) -> None:
    """Bones keep their lengths, unlike those of joints smoothed one by one."""
    expected = bones(model, model.joints(trembling[:1]))
    lengths = bones(model, smoothed(model, trembling))
    np.testing.assert_allclose(lengths, np.tile(expected, (len(lengths), 1)), atol=1e-9)


def test_a_moving_hand_is_not_left_behind(model: CapsuleModel) -> None:
    """At half a metre and half a turn per second, with closing fingers, the lag is less than a frame."""
    x = np.zeros((len(TIMES), model.variables))
    x[:, 0] = 500 * TIMES / 150
    x[:, 5] = np.pi * TIMES
    x[:, model.limbs] = np.clip(0.5 * TIMES[:, None], 0, 1)
    raw, found = model.joints(x), smoothed(model, x)
    behind = np.linalg.norm(found - raw, axis=2).mean(axis=1)
    way = np.linalg.norm(np.diff(raw, axis=0), axis=2).mean(axis=1)
    assert behind[30:].max() < way[30:].max()


def test_a_pose_that_is_not_sure_moves_little(model: CapsuleModel, trembling: np.ndarray) -> None:
    """A larger expected error gives a smaller weight, which is never 0; an unknown error counts as a small one."""
    other = trembling[0].copy()
    other[model.limbs] += 0.5
    ways = []
    for error in (float("nan"), 3.0, 30.0, 52.0, 75.0, 600.0):
        one = PoseFilter()
        first = one(world_pose(model, trembling[0], CENTER), 0.0, 4.0)
        second = one(world_pose(model, other, CENTER), 1 / 30, error)
        ways.append(np.abs(second.others - first.others).max())
    assert ways[0] == ways[1] == ways[2] > 1.5 * ways[3] > 1.5 * ways[4] > 0
    assert ways[4] == ways[5]
