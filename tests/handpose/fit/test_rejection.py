"""handpose/fit/rejection.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import SIZE, THICKNESS, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.observation import HandCrops
from handpose.fit.rejection import (
    CAP_MM,
    COST_MM,
    MOVED,
    OUTSIDE_MM,
    STRETCHED_MM,
    USUAL_SIZE,
    USUAL_THICKNESS,
    rejection_score,
)
from handpose.frames.cameras import NYU
from handpose.synthetic.recipes import recipe

UVD = np.array([[320.0, 240, 700]])


def score(
    model: CapsuleModel, fit: DepthFit, crop: np.ndarray, uvd: np.ndarray = UVD, known_size: bool = False
) -> float:
    """The score of a right hand in NYU's cube."""
    return float(rejection_score(model, fit, HandCrops.of_sides(crop, uvd, NYU, 300.0), known_size=known_size)[0])


@pytest.fixture
def fit(model: CapsuleModel) -> DepthFit:
    """A hand of typical size at rest, perfectly fitted."""
    x, one = np.zeros((1, model.variables)), np.ones(1)
    x[0, SIZE] = np.log(TYPICAL_SIZE)
    joints = model.joints(x)
    return DepthFit(model.inputs_of(x), one, joints, joints, one, one, one, one, x, np.zeros((1, 5)), np.zeros(1, int))


@pytest.fixture
def crop(model: CapsuleModel, fit: DepthFit) -> np.ndarray:
    """The depth image of that hand."""
    depth = render_crop(model.capsules(fit.x, NYU.unproject(UVD)), UVD, 300.0)
    return normalise_depth(depth, UVD[:, 2], 300.0)


def test_a_hand_is_not_rejected(model: CapsuleModel, fit: DepthFit, crop: np.ndarray) -> None:
    """A correctly predicted hand in the right place has a score near 0."""
    assert score(model, fit, crop) < 0.1


def test_each_figure(model: CapsuleModel, fit: DepthFit, crop: np.ndarray) -> None:
    """An empty crop, a moved prediction, a hand outside the image, a cost and an unusual size add to the score."""

    def of(fit: DepthFit = fit, crop: np.ndarray = crop, uvd: np.ndarray = UVD) -> float:
        return score(model, fit, crop, uvd)

    assert of(crop=np.ones_like(crop)) == pytest.approx(2 * CAP_MM, abs=1)
    assert of(replace(fit, network=fit.joints + (20, 0, 0))) == pytest.approx(MOVED * 20 + of())
    assert of(crop=np.ones_like(crop), uvd=np.array([[-300.0, 240, 700]])) >= OUTSIDE_MM
    assert of(replace(fit, cost=np.array([np.e**3]))) == pytest.approx(3 * COST_MM + of())
    for variable, usual in ((SIZE, USUAL_SIZE), (THICKNESS, USUAL_THICKNESS)):
        smaller = fit.x.copy()
        smaller[0, variable] -= usual + 0.1
        assert of(replace(fit, x=smaller)) > 0.1 * STRETCHED_MM


def test_a_known_size_is_not_rejected(model: CapsuleModel, fit: DepthFit, crop: np.ndarray) -> None:
    """Usual sizes are not charged, and unusual ones only until a recording has determined the size."""
    x = fit.x.copy()
    for less, charged in ((0.2, 0.0), (USUAL_SIZE + 0.1, 0.1)):
        x[0, SIZE] = np.log(TYPICAL_SIZE) - less
        smaller = replace(fit, x=x)
        unknown, known = score(model, smaller, crop), score(model, smaller, crop, known_size=True)
        assert unknown - known == pytest.approx(charged * STRETCHED_MM)


def test_the_typical_size_is_that_of_the_training_frames() -> None:
    """The recipe of the packaged weights samples sizes around the typical size."""
    assert recipe("people").prior.scale_mean == TYPICAL_SIZE


def test_a_stick_on_one_finger_is_rejected(model: CapsuleModel, fit: DepthFit, crop: np.ndarray) -> None:
    """If most of the hand was not seen, the score is high, even if a single finger fits well."""
    stick = np.where(np.arange(128) > 64, crop, 1.0).astype(np.float32)  # a part of the hand's own picture
    assert score(model, fit, stick) > 15
