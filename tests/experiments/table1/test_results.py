"""experiments/table1/results.py"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.table1.results import Truth, angles_of, figures, frames_to_show, truth_of
from experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL
from handpose.scoring.held_out import Predictions
from handpose.synthetic.generator import Generator
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tests.support.hdf5_files import write_hdf5

SKELETON = skeleton.load()
FRAMES = Generator(5, "test").block(0)
assert FRAMES.dof is not None
INPUTS = FRAMES.dof[:24].astype(np.float64)
HALF_CUBE = np.where(np.arange(24) % 8 < 4, 150.0, 130.5)


def predicted(inputs: np.ndarray, bones: np.ndarray | None = None) -> Predictions:
    """The predictions of a network with a hand model for these angles and bones."""
    kinematics = kinematics_of(SKELETON)
    joints = kinematics.joints(inputs)
    return Predictions(joints, kinematics.joints(INPUTS, bones), inputs, joints, HALF_CUBE, {}, "a test")


def test_figures_of_a_perfect_network() -> None:
    """True joints have no error, with true or with fitted angles, except for angles that joints do not determine."""
    perfect, truth = predicted(INPUTS), Truth(INPUTS, INPUTS)
    error, (same, smaller) = figures(ONE_HAND, perfect, angles_of(perfect, SKELETON), truth, SKELETON)
    assert error == pytest.approx(0, abs=1e-6) and (same.subject, smaller.subject) == ("same hand", "smaller hand")
    assert (same.frames, smaller.frames, same.within_40_mm, same.success[1]) == (12, 12, 1, 1)
    assert same.angle_deg == pytest.approx(0, abs=1e-5) and same.out_of_limits == 0 and np.isnan(same.own_bones_mm)
    bare = replace(perfect, dof=None)
    _, (fitted, _) = figures(ONE_HAND, bare, angles_of(bare, SKELETON), truth, SKELETON)
    assert fitted.error_mm == pytest.approx(0, abs=1e-6) and fitted.angle_deg < 2 and np.isnan(fitted.out_of_limits)


def test_mm_are_those_of_the_subject_s_cube() -> None:
    """A tenth of a half-cube is 15 mm for one subject and 13.05 mm for the other; the total error is the mean."""
    palm = SKELETON.dof_names.index("palm_x")
    moved = INPUTS.copy()
    moved[:, palm] += 0.1
    predictions = predicted(moved)
    truth = Truth(INPUTS + 0.01, INPUTS)
    error, (same, smaller) = figures(ONE_HAND, predictions, moved, truth, SKELETON)
    assert (same.error_14_mm, smaller.error_14_mm, error) == pytest.approx((15, 13.05, 14.025))
    assert same.joints_mm == pytest.approx([15] * 31) and same.success[7:9] == [0, 1]
    assert same.angle_deg == pytest.approx(0, abs=1e-6) and same.fitted_angle_deg > 0.2


def test_what_bones_give_back() -> None:
    """True angles are wrong on the skeleton's bones, right on the person's own.

    A common factor is enough only if all bones differ by the same one."""
    rng = np.random.default_rng(0)
    one = np.tile(SKELETON.bones * 1.1, (24, 1))
    several = one * rng.uniform(0.9, 1.1, one.shape)
    for bones, scaled_is_enough in ((one, True), (several, False)):
        error, (people,) = figures(MANY_HANDS, predicted(INPUTS, bones), INPUTS, Truth(INPUTS, INPUTS, bones), SKELETON)
        assert people.subject == "many people" and error > 3 and people.own_bones_mm == pytest.approx(0, abs=1e-6)
        assert people.scaled_mm == pytest.approx(0, abs=1e-6) if scaled_is_enough else 0.5 < people.scaled_mm < error


def test_frames_of_nobody() -> None:
    """A half-cube of no subject raises an error; the frames to draw are the first subject's."""
    assert {HALF_CUBE[i] for i in frames_to_show(ONE_HAND, predicted(INPUTS))} == {150.0}
    other = replace(predicted(INPUTS), half_cube=np.full(24, 140.0))
    with pytest.raises(DataError, match=r"half_cube of frame 0 is 140 mm, expected one of 150 \(same hand\), 130.5"):
        figures(ONE_HAND, other, INPUTS, Truth(INPUTS), SKELETON)


def test_the_truth_of_a_setting(tmp_path: Path) -> None:
    """Exact angles are read for synthetic hands, bones where they vary; a wrong shape raises an error."""
    for name in ("one_hand", "many_hands", "nyu"):
        (tmp_path / name).mkdir()
        write_hdf5(tmp_path / name / "a.h5", dof=INPUTS, bones=np.ones((24, 31)))
        (tmp_path / name / "test.txt").write_text("a.h5\n")
    settings = [replace(setting, folder=tmp_path / setting.name) for setting in (ONE_HAND, MANY_HANDS, REAL)]
    one, many, real = (truth_of(setting, INPUTS) for setting in settings)
    assert one.exact is not None and np.array_equal(one.exact, INPUTS) and one.bones is None
    assert many.bones is not None and many.bones.shape == (24, 31) and real.exact is None
    with pytest.raises(DataError, match=r"'dof' has shape \(24, 47\), expected \(N, 40\)"):
        truth_of(settings[0], INPUTS[:, :40])
