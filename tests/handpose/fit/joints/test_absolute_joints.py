"""handpose/fit/joints/absolute_joints.py; more of it in the tests of tools/fit_pose.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.joints.absolute_joints import fit_absolute
from handpose.fit.joints.particle_swarm import fit_joints_by_swarm
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of

SKELETON = skeletons.load()
ALL = range(31)
HALF = np.array([150.0, 130.5, 150.0])


@pytest.fixture
def xyz() -> np.ndarray:
    """The joints in mm of three hands with two cube sizes."""
    inputs = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)).draw(np.random.default_rng(0), 3).inputs
    return np.asarray(kinematics_of(SKELETON).joints(inputs) * HALF[:, None, None] + (20, -30, 800))


def test_the_joints_are_found_where_they_are(xyz: np.ndarray) -> None:
    """Each hand is fitted in its own unit, about its own centre, to within 0.01 mm."""
    found = fit_absolute(SKELETON, xyz, HALF, ALL, starts=4)
    placed = kinematics_of(SKELETON).joints(found.inputs) * HALF[:, None, None] + found.center[:, None]
    assert np.abs(placed - xyz).max() < 0.01
    assert found.residuals_mm == pytest.approx(np.linalg.norm(placed - xyz, axis=2), abs=1e-6)


def test_the_way_of_fitting(xyz: np.ndarray) -> None:
    """Another fitting function receives its options, and ``progress`` counts every frame."""
    reported: list[int] = []
    options = {"particles": 4, "generations": 2, "progress": reported.append}
    found = fit_absolute(SKELETON, xyz, HALF, ALL, fit=fit_joints_by_swarm, **options)
    assert sum(reported) == 3 and found.residuals_mm.mean() > 1
