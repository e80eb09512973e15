"""experiments/table1.py: scores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments import table1
from experiments.table1 import scores
from handpose.scoring.held_out import Predictions
from handpose.synthetic.generator import Generator
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of

SKELETON = skeleton.load()
FRAMES = Generator(5, "test").block(0)
assert FRAMES.dof is not None
INPUTS = FRAMES.dof[:24].astype(np.float64)
HALF_CUBE = np.where(np.arange(24) % 8 < 4, 150.0, 130.5)


def predicted(inputs: np.ndarray, bones: np.ndarray | None = None) -> Predictions:
    """The predictions of a network with a hand model, for hands of these bones."""
    kinematics = kinematics_of(SKELETON)
    joints = kinematics.joints(inputs)
    return Predictions(
        joints, kinematics.joints(INPUTS, bones), inputs, joints, HALF_CUBE, {}, "a test"
    )


def test_scores_of_a_perfect_network() -> None:
    """True joints have no error, with true or with fitted angles, except for angles that joints do
    not determine.
    """
    perfect = predicted(INPUTS)
    row = scores(perfect, INPUTS, INPUTS, INPUTS, None, SKELETON)
    assert row == {
        "error": "0.00",
        "cube of 300": "0.00",
        "cube of 261": "0.00",
        "fitted angles": "0.00°",
        "exact angles": "0.00°",
        "out of limits": "0.0%",
        "max <= 40": "100.0%",
    }
    bare = replace(perfect, dof=None)
    row = scores(
        bare, table1.angles_of(bare, SKELETON, lambda done: None), INPUTS, None, None, SKELETON
    )
    assert (row["error"], row["exact angles"], row["out of limits"]) == ("0.00", "–", "–")
    assert float(row["fitted angles"].rstrip("°")) < 2


def test_mm_are_those_of_the_frames_cube() -> None:
    """A tenth of a half-cube is 15 mm for one subject and 13.05 mm for the other; the total
    error is the mean.
    """
    moved = INPUTS.copy()
    moved[:, SKELETON.dof_names.index("palm_x")] += 0.1
    row = scores(predicted(moved), moved, INPUTS + 0.01, INPUTS, None, SKELETON)
    assert [float(row[name]) for name in ("error", "cube of 300", "cube of 261")] == pytest.approx(
        [14.025, 15, 13.05], abs=0.006
    )
    assert row["exact angles"] == "0.00°" and float(row["fitted angles"].rstrip("°")) > 0.2


def test_true_bones_remove_the_error(rng: np.random.Generator) -> None:
    """True angles are right on the person's bones; a common factor is enough only if all bones
    differ by the same.
    """
    one = np.tile(SKELETON.bones * 1.1, (24, 1))
    several = one * rng.uniform(0.9, 1.1, one.shape)
    for bones, scaled_is_enough in ((one, True), (several, False)):
        row = scores(predicted(INPUTS, bones), INPUTS, INPUTS, INPUTS, bones, SKELETON)
        assert float(row["error"]) > 3 and row["person's bones"] == "0.00"
        assert (row["scaled hand"] == "0.00") == scaled_is_enough
        assert float(row["scaled hand"]) < float(row["error"])
