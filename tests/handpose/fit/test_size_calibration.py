"""handpose/fit/size_calibration.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import SIZE, THICKNESS, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.observation import observe
from handpose.fit.size_calibration import GRID, _lowest, calibrate_size
from handpose.frames.cameras import NYU
from tests.handpose.fit.conftest import Scene


@pytest.mark.parametrize(("size", "thickness"), [(0.92, 1.15), (0.761, 1.0), (1.329, 1.0)])
def test_the_size_of_a_hand(model: CapsuleModel, scene: Scene, size: float, thickness: float) -> None:
    """Size and thickness are found from six frames that were fitted with another size."""
    truth, uvd = scene.truth[:6].copy(), scene.center_uvd[:6]
    truth[:, SIZE], truth[:, THICKNESS] = np.log(size), np.log(thickness)
    capsules = model.capsules(truth, NYU.unproject(uvd))
    depth = render_crop(capsules, uvd, 300.0)
    seen = observe(normalise_depth(depth, uvd[:, 2], 300.0), uvd, NYU, 300.0, 200)
    fitted = scene.truth[:6] + np.random.default_rng(0).normal(0, 0.03, truth.shape)
    done: list[int] = []
    found = calibrate_size(DepthFitter(model), seen, fitted, done.append)
    assert found.size == pytest.approx(size, abs=0.012) and found.thickness == pytest.approx(thickness, abs=0.07)
    assert sum(done) == 6 * len(GRID)
    assert found.costs.argmin() == np.abs(GRID - size).argmin()


def test_sizes_that_are_tried(model: CapsuleModel, scene: Scene) -> None:
    """A few sizes near the true one give the same result; a size outside their range is not found."""
    truth = scene.truth.copy()
    truth[:, SIZE] = np.log(0.95)
    depth = render_crop(model.capsules(truth, NYU.unproject(scene.center_uvd)), scene.center_uvd, 300.0)
    seen = observe(normalise_depth(depth, scene.center_uvd[:, 2], 300.0), scene.center_uvd, NYU, 300.0, 200)
    fitter = DepthFitter(model)
    near = np.exp(np.linspace(-0.1, 0.05, 6))
    found = calibrate_size(fitter, seen, truth, sizes=near)
    assert found.size == pytest.approx(0.95, abs=0.015)
    np.testing.assert_array_equal(found.sizes, near)
    assert found.costs.shape == (6,)
    larger = calibrate_size(fitter, seen, truth, sizes=1.05 * near[-3:] / near[-3])
    assert larger.size <= 1.05 and larger.costs.argmin() == 0


def test_people_as_a_prior(model: CapsuleModel, scene: Scene) -> None:
    """The prior adds to the cost of each size as for one frame, and moves the result towards the typical size."""
    fitter, sizes = DepthFitter(model), np.exp(np.linspace(-0.05, 0.1, 7))
    alone = calibrate_size(fitter, scene.seen, scene.truth, sizes=sizes)
    people = calibrate_size(fitter, scene.seen, scene.truth, sizes=sizes, deviation=0.02)
    added = (np.log(sizes / TYPICAL_SIZE) / 0.02) ** 2
    np.testing.assert_allclose(people.costs - alone.costs, added)
    assert TYPICAL_SIZE < people.size < alone.size


def test_the_least_of_few_costs() -> None:
    """The minimum is that of a parabola, or the first or last size if the costs decrease towards it."""
    sizes = np.exp([-0.1, 0.0, 0.1])
    assert _lowest(sizes, np.array([2.0, 1.0, 2.0])) == pytest.approx(1.0)
    assert _lowest(sizes, np.array([1.0, 1.0, 2.0])) == pytest.approx(np.exp(-0.05))
    assert _lowest(sizes, np.array([1.0, 3.0, 4.0])) == pytest.approx(sizes[0])
    assert _lowest(sizes, np.array([4.0, 3.0, 1.0])) == pytest.approx(sizes[2])
