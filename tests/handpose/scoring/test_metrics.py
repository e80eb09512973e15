"""handpose/scoring/metrics.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.scoring import metrics
from netlib.errors import DataError


def test_joint_errors() -> None:
    truth = np.zeros((1, 2, 3))
    predicted = np.array([[[3.0, 4.0, 0.0], [1.0, 2.0, 2.0]]])
    assert_allclose(metrics.joint_errors(predicted, truth), [[5, 3]])


def test_means_over_nyus_joints() -> None:
    truth = np.zeros((2, 31, 3))
    joints = truth.copy()
    joints[1, EVALUATION_JOINTS[0]] = (0, 3, 4)
    joints[0, [k for k in range(31) if k not in EVALUATION_JOINTS]] = 9
    assert metrics.mean_errors_14(joints, truth) == pytest.approx([0, 5 / 14])


def test_success_rate() -> None:
    """A frame succeeds at a threshold if its worst (or mean) joint error is at most that."""
    errors = np.array([[3.0, 5.0], [10.0, 0.0], [20.0, 40.0]])
    assert_allclose(metrics.success_rate(errors, [4, 5, 10, 40]), [0, 1 / 3, 2 / 3, 1])
    assert_allclose(metrics.success_rate(errors, [4, 5, 30], worst=False), [1 / 3, 2 / 3, 1])


def test_fraction_out_of_limits() -> None:
    """A frame counts once for any number of angles; fixed angles are ignored; a tolerance
    widens the limits.
    """
    inputs = np.array([[0.0, 9.0], [1.1, 0.0], [-5.0, 0.0], [1.0, 0.0]])
    limits = {"lower": [-1, -1], "upper": [1, 1], "fixed": [False, True]}
    assert metrics.fraction_out_of_limits(inputs, **limits) == 0.5
    assert metrics.fraction_out_of_limits(inputs, **limits, tolerance=0.2) == 0.25


def test_shapes_must_match() -> None:
    with pytest.raises(DataError, match=r"\(2, 14, 3\).*\(2, 31, 3\)"):
        metrics.joint_errors(np.zeros((2, 14, 3)), np.zeros((2, 31, 3)))
