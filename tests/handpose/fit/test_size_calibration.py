"""handpose/fit/size_calibration.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import MAX_SIZE, MIN_SIZE, SIZE, THICKNESS, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.observation import Observation, observe
from handpose.fit.size_calibration import _lowest, calibrate_size
from handpose.frames.cameras import NYU
from tests.handpose.fit.conftest import Scene


def drawn(model: CapsuleModel, scene: Scene, size: float, thickness: float) -> tuple[Observation, np.ndarray]:
    """Six of the hands with this size and thickness, and fits of them with another size."""
    truth, uvd = scene.truth[:6].copy(), scene.center_uvd[:6]
    truth[:, SIZE], truth[:, THICKNESS] = np.log(size), np.log(thickness)
    depth = render_crop(model.capsules(truth, NYU.unproject(uvd)), uvd, 300.0)
    fitted = scene.truth[:6] + np.random.default_rng(0).normal(0, 0.03, truth.shape)
    return observe(normalise_depth(depth, uvd[:, 2], 300.0), uvd, NYU, 300.0, 200), fitted


@pytest.mark.parametrize(("size", "thickness"), [(0.92, 1.15), (0.761, 1.0), (1.329, 1.0)])
def test_the_size_of_a_hand(model: CapsuleModel, scene: Scene, size: float, thickness: float) -> None:
    sizes = np.geomspace(MIN_SIZE, MAX_SIZE, 25)
    found = calibrate_size(DepthFitter(model), *drawn(model, scene, size, thickness), sizes)
    assert found.size == pytest.approx(size, abs=0.012) and found.thickness == pytest.approx(thickness, abs=0.07)


def test_sizes_that_are_tried(model: CapsuleModel, scene: Scene) -> None:
    """A few sizes near the true one give it; one outside their range is not found; the prior pulls to the typical."""
    near, fitter, seen = np.exp(np.linspace(-0.1, 0.05, 6)), DepthFitter(model), drawn(model, scene, 0.95, 1.0)
    alone = calibrate_size(fitter, *seen, near).size
    assert alone == pytest.approx(0.95, abs=0.015)
    assert calibrate_size(fitter, *seen, 1.05 * near[-3:] / near[-3]).size <= 1.05
    assert TYPICAL_SIZE < calibrate_size(fitter, *seen, near, deviation=0.005).size < alone


def test_the_least_of_few_costs() -> None:
    """The minimum is that of a parabola, or the first or last size if the costs decrease towards it."""
    sizes = np.exp([-0.1, 0.0, 0.1])
    assert _lowest(sizes, np.array([2.0, 1.0, 2.0])) == pytest.approx(1.0)
    assert _lowest(sizes, np.array([1.0, 1.0, 2.0])) == pytest.approx(np.exp(-0.05))
    assert _lowest(sizes, np.array([1.0, 3.0, 4.0])) == pytest.approx(sizes[0])
    assert _lowest(sizes, np.array([4.0, 3.0, 1.0])) == pytest.approx(sizes[2])
