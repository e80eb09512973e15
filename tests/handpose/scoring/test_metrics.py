"""handpose/scoring/metrics.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handpose.body.nyu import EVALUATION_JOINTS, SECOND_SUBJECT
from handpose.frames.cameras import NYU
from handpose.scoring import metrics
from netlib.errors import DataError

ERRORS = np.array([[3.0, 5.0], [10.0, 0.0], [20.0, 40.0]])


def test_joint_errors() -> None:
    truth = np.zeros((1, 2, 3))
    predicted = np.array([[[3.0, 4.0, 0.0], [1.0, 2.0, 2.0]]])
    np.testing.assert_allclose(metrics.joint_errors(predicted, truth), [[5, 3]])


def test_means_over_nyus_joints() -> None:
    truth = np.zeros((2, 31, 3))
    joints = truth.copy()
    joints[1, EVALUATION_JOINTS[0]] = (0, 3, 4)
    joints[0, [k for k in range(31) if k not in EVALUATION_JOINTS]] = 9
    assert metrics.mean_errors_14(joints, truth) == pytest.approx([0, 5 / 14])


def test_means() -> None:
    """The mean is over all errors, or over the frames for each joint."""
    assert metrics.mean_error(ERRORS) == pytest.approx(13)
    np.testing.assert_allclose(metrics.mean_error_per_joint(ERRORS), [11, 15])


def test_success_rate() -> None:
    """A frame succeeds at a threshold if its worst (or mean) joint error is at most that."""
    np.testing.assert_allclose(metrics.success_rate(ERRORS, [4, 5, 10, 40]), [0, 1 / 3, 2 / 3, 1])
    np.testing.assert_allclose(metrics.success_rate(ERRORS, [4, 5, 30], worst=False), [1 / 3, 2 / 3, 1])


def test_fraction_out_of_limits() -> None:
    """A frame counts once for any number of angles; fixed angles are ignored; a tolerance widens the limits."""
    inputs = np.array([[0.0, 9.0], [1.1, 0.0], [-5.0, 0.0], [1.0, 0.0]])
    limits = {"lower": [-1, -1], "upper": [1, 1], "fixed": [False, True]}
    assert metrics.fraction_out_of_limits(inputs, **limits) == 0.5
    assert metrics.fraction_out_of_limits(inputs, **limits, tolerance=0.2) == 0.25


def test_shapes_must_match() -> None:
    with pytest.raises(DataError, match=r"\(2, 14, 3\).*\(2, 31, 3\)"):
        metrics.joint_errors(np.zeros((2, 14, 3)), np.zeros((2, 31, 3)))


@pytest.mark.parametrize(
    ("name", "mean"),
    [("IJCAI16_NYU_DeepModel", 17.0359), ("CVWW15_NYU_Prior", 20.7499), ("ICCV15_NYU_Feedback", 15.9727)],
)
def test_published_results(nyu_data: Path, name: str, mean: float) -> None:
    truth = np.loadtxt(nyu_data / "test_groundtruth_uvd.txt").reshape(-1, 14, 3)
    predicted = np.loadtxt(nyu_data / "predictions" / f"{name}.txt").reshape(-1, 14, 3)
    errors = metrics.joint_errors(NYU.unproject(predicted), NYU.unproject(truth))
    assert metrics.mean_error(errors) == pytest.approx(mean, abs=1e-4)
    if name == "IJCAI16_NYU_DeepModel":
        assert errors[:SECOND_SUBJECT].mean() == pytest.approx(10.154, abs=1e-3)
        assert errors[SECOND_SUBJECT:].mean() == pytest.approx(19.925, abs=1e-3)
        rates = metrics.success_rate(errors, [10, 20, 30, 40, 50, 60, 70, 80])
        np.testing.assert_allclose(rates, [0.019, 0.190, 0.419, 0.582, 0.718, 0.834, 0.911, 0.951], atol=6e-4)
