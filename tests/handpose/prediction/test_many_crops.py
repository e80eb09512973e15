"""handpose/prediction/many.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.cameras import NYU
from handpose.prediction import many
from handpose.prediction.many import fit_crops
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor
from handpose.synthetic.generator import Generator, Scene


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """The packaged one, fast."""
    return load_predictor(fit="fast", hand="right")


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Some frames."""
    return Generator(9).scene(0)


def test_blocks_change_nothing(predictor: Predictor, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten crops at once, or four at a time: the same to rounding, which now and then tips a fit into another valley."""
    done: list[int] = []
    args = (predictor.net, predictor.fitter, scene.depth[:10], scene.center_uvd[:10], NYU, "fast")
    whole = fit_crops(*args)
    monkeypatch.setattr(many, "TOGETHER", 4)
    parts = fit_crops(*args, progress=done.append)
    apart = np.linalg.norm(parts.joints - whole.joints, axis=2).max(axis=1)  # mm
    assert np.median(apart) < 0.1 and (apart < 1).mean() >= 0.7
    assert done == [4, 4, 2] and whole.inputs.shape == (10, 47)


def test_left_hands_in_the_mirror(predictor: Predictor, scene: Scene) -> None:
    """The mirrored crop of a hand, seen as a left one, has the same pose, but for the pixel by which crops differ."""
    fitter = predictor.fitter
    right = fit_crops(predictor.net, fitter, scene.depth[:8], scene.center_uvd[:8], NYU, "fast")
    uvd = scene.center_uvd[:8] * (-1, 1, 1) + (2 * NYU.u0, 0, 0)
    left = fit_crops(predictor.net, fitter, scene.depth[:8, :, ::-1], uvd, NYU, "fast", side="left")
    apart = np.linalg.norm(left.joints - right.joints, axis=2).mean(axis=1)
    assert np.median(apart) < 8


def test_a_known_size(predictor: Predictor, scene: Scene) -> None:
    """Is kept."""
    found = fit_crops(predictor.net, predictor.fitter, scene.depth[:2], scene.center_uvd[:2], NYU, "fast", size=0.95)
    assert found.size == pytest.approx(0.95, abs=3e-3)
