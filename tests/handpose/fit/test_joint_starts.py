"""handpose/fit/joint_starts.py"""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.joint_starts import aligned, near_joints
from handpose.fit.settings import JointStartSettings
from tests.handpose.fit.conftest import Scene, error

SETTINGS = JointStartSettings()


def test_true_joints(model: CapsuleModel, scene: Scene, rng: np.random.Generator) -> None:
    """From angles 0.2 radians off, the true pose is found nearly, because the start keeps
    a small weight.
    """
    start = scene.truth.copy()
    start[:, model.limbs] += rng.normal(0, 0.2, (12, 20))
    start = np.clip(start, model.lower, model.upper)
    found = near_joints(model, start, scene.joints, SETTINGS)
    assert error(model, found, scene).max() < 4 and error(model, start, scene).mean() > 8
    assert (found >= model.lower).all() and (found <= model.upper).all()
    assert_array_equal(found[:, model.own], start[:, model.own])


def test_joints_of_another_size(model: CapsuleModel, scene: Scene) -> None:
    """The size grows with joints that are farther from the root than the skeleton's."""
    root = scene.joints[:, [24]]
    found = near_joints(model, scene.truth, root + 1.1 * (scene.joints - root), SETTINGS)
    assert_allclose(np.exp(found[:, SIZE_INDEX]), 1.1, atol=0.02)


def test_fitting_a_body_reduces_independent_joint_errors(model: CapsuleModel, scene: Scene) -> None:
    """The given errors are 14 mm (root mean square)."""
    noisy = scene.joints + np.random.default_rng(1).normal(0, 14 / 3**0.5, scene.joints.shape)
    found = near_joints(model, scene.truth, noisy, SETTINGS)
    given = np.linalg.norm(noisy - scene.joints, axis=2).mean()
    assert error(model, found, scene).mean() < 0.6 * given


def test_another_rotation(model: CapsuleModel, scene: Scene) -> None:
    """A rotated and shifted body is aligned with the joints, exactly if its limb
    angles are right.
    """
    start = scene.truth.copy()
    shift = np.random.default_rng(2).normal(0, 2, (12, 6))
    start[:, model.root] += shift * ([0.1] * 3 + [1] * 3)
    assert error(model, start, scene).min() > 15
    assert error(model, aligned(model, start, scene.joints), scene).max() < 1e-3
    assert error(model, near_joints(model, start, scene.joints, SETTINGS), scene).max() < 1e-3
