"""experiments/fit_figures.py"""

from __future__ import annotations

import numpy as np
import pytest

from experiments.fit_figures import auc, frames_of, measure, roll_of
from handpose.estimate.estimator import fit_starts
from handpose.estimate.packaged import load_predictor
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.search import ACCURATE, FAST
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic import recipes
from handpose.synthetic.generator import Generator
from layers.hand import skeleton


def test_figures_of_the_packaged_network() -> None:
    """On 24 unused frames the fits beat the network, recognise the side, and estimate their error."""
    predictor = load_predictor()
    assert predictor.fitter is not None
    fitter = predictor.fitter
    done: list[int] = []
    frames = frames_of(Generator(77, "test", recipes.recipe("people")), 24)
    found = measure(predictor.net, lambda unit: fitter, frames, (FAST, ACCURATE), hands=True, progress=done.append)
    assert done == [24] and len(found.network) == 24 and found.limbs.shape == (24, 20)
    network, fast, accurate = (np.median(e) for e in (found.network, found.fits["fast"], found.fits["accurate"]))
    assert accurate < fast < 0.6 * network and accurate < 6
    assert found.right["accurate"].mean() > 0.95
    expected = found.expected["accurate"]
    assert expected.shape == (24,) and 2 < np.median(expected) < 12
    assert ((found.confidence["fast"] >= 0) & (found.confidence["fast"] <= 1)).all()


def test_frames_are_those_of_the_generator() -> None:
    """The requested number of frames comes in blocks of one camera."""
    blocks = list(frames_of(Generator(1, "test", recipes.recipe("cameras")), 70))
    assert [len(block.crops) for block in blocks] == [64, 6]
    assert {len(block.joints) for block in blocks} == {64, 6} and blocks[0].joints.shape[1:] == (31, 3)


def test_crops_of_another_cube() -> None:
    """Frames of a second subject are fitted by a fitter for its smaller cube."""
    blocks = list(frames_of(Generator(1, "test", recipes.recipe("one_hand")), 65))
    assert [block.unit for block in blocks] == [150, 130.5]
    predictor = load_predictor()
    assert predictor.fitter is not None
    skeleton, made = predictor.fitter.model.skeleton, []

    def fitter_of(unit: float) -> DepthFitter:
        made.append(unit)
        return DepthFitter(CapsuleModel(skeleton, unit))

    found = measure(predictor.net, fitter_of, iter([*blocks, blocks[1]]), ())
    assert made == [150, 130.5]
    own = CapsuleModel(skeleton, 130.5)
    (x,) = fit_starts(predictor.net, own, blocks[1].crops, (0,))
    assert found.network[64:65] == pytest.approx(mean_errors_14(own.joints(x), blocks[1].joints))


def test_auc() -> None:
    """Of 2 failed and 3 good frames, 5 of the 6 pairs are in order; with only one kind the result is NaN."""
    score = np.array([1.0, 2, 3, 4, 5])
    failed = np.array([False, False, True, False, True])
    assert auc(score, failed) == pytest.approx(5 / 6)
    assert np.isnan(auc(score, np.zeros(5, bool)))


def test_roll() -> None:
    """Angles are in degrees between -180 and 180."""
    inputs = np.zeros((3, 47))
    inputs[:, 5] = (0.1, np.pi + 0.1, -7)
    np.testing.assert_allclose(roll_of(skeleton.load(), inputs), np.rad2deg([0.1, 0.1 - np.pi, 2 * np.pi - 7]))
