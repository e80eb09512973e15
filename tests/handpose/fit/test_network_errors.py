"""handpose/fit/network_errors.py"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import (
    GOOD_MM,
    POSE_STD,
    SIGNS,
    UNKNOWN_STD,
    NetworkErrors,
    Poses,
    arrays_of,
    covariance,
    read_errors,
    table_of,
    uncertainty_of,
    weights_of,
)
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5

TABLE = np.array([[10.0, 4, 1], [50, 8, 0.9], [200, 40, 0.2]])
EVEN = np.full(len(SIGNS), 1 / len(SIGNS))


def all_signs(uncertainty: list[float]) -> np.ndarray:
    """Signs (N, 5) with equal values in each row, so that any weights give this uncertainty."""
    return np.repeat(np.array(uncertainty)[:, None] - 1, len(SIGNS), axis=1)


def write(path: Path, **arrays: object) -> Path:
    """A file with a group ``fit``."""
    return write_hdf5(path, **{f"fit/{name}": values for name, values in arrays.items()}, **{"data/ip": 0})


def test_read(model: CapsuleModel, tmp_path: Path) -> None:
    """Covariance, weights and tables are read; tables are interpolated, and extrapolated in proportion at the end."""
    own = np.eye(20) * 0.04
    found = read_errors(write(tmp_path / "w.h5", **{"limbs": own, "fast": TABLE, "fast.signs": EVEN}), model)
    np.testing.assert_array_equal(found.limbs, own)
    uncertainty, expected, chance = found.expected("fast", all_signs([1.0, 30, 125, 400]))
    np.testing.assert_allclose(uncertainty, [1, 30, 125, 400])
    np.testing.assert_allclose(expected, [4, 6, 24, 80])
    np.testing.assert_allclose(chance, [1, 0.95, 0.55, 0.1])
    uncertainty, *unknown = found.expected("accurate", all_signs([7.0, 9]))
    np.testing.assert_allclose(uncertainty, [7, 9])
    assert np.isnan(unknown).all()
    again = read_errors(write(tmp_path / "again.h5", **arrays_of(found)), model)
    np.testing.assert_array_equal(again.weights["fast"], EVEN)


def test_natural_poses(model: CapsuleModel, tmp_path: Path) -> None:
    """Mean and covariance of poses are stored and read; a limb that never moves keeps the covariance invertible."""
    limbs = np.random.default_rng(0).normal(0.5, 0.2, (1000, 20))
    limbs[:, 7] = 0.1
    poses = Poses.of(limbs)
    np.testing.assert_allclose(poses.mean, limbs.mean(axis=0))
    np.testing.assert_allclose(poses.covariance, np.cov(limbs.T, bias=True) + np.eye(20) * POSE_STD**2)
    found = read_errors(write(tmp_path / "w.h5", **arrays_of(NetworkErrors(np.eye(20), {}, {}, poses))), model).poses
    assert found is not None
    np.testing.assert_array_equal(found.mean, poses.mean)
    np.testing.assert_array_equal(found.covariance, poses.covariance)
    assert read_errors(write(tmp_path / "without.h5", limbs=np.eye(20)), model).poses is None


def test_weights_that_nobody_measured(model: CapsuleModel, tmp_path: Path) -> None:
    """For Caffe's weights, or those of another format, a default spread is assumed and the confidence is NaN."""
    with h5py.File(tmp_path / "w.h5", "w") as file:
        file.create_group("data")
    (tmp_path / "binary.caffemodel").write_bytes(b"\x0a\x03abc")
    for name in ("w.h5", "binary.caffemodel"):
        found = read_errors(tmp_path / name, model)
        np.testing.assert_allclose(found.limbs, np.eye(20) * UNKNOWN_STD**2)
        assert np.isnan(found.expected("fast", all_signs([3]))[1:]).all()


LIMBS, AGAIN = "expected a covariance (20, 20)", "package the weights again"
SIGNLESS = f"a table without weights of signs, or weights without a table; {AGAIN}"
ROWS = "expected rows of uncertainty, error, chance"
ZEROS = TABLE * (0, 1, 1) + ((0, 0, 0), (1, 0, 0), (2, 0, 0))


@bad_inputs(DataError, {
    name: (arrays, f"...w.h5: {line}") for name, arrays, line in (
        ("19 limbs", {"limbs": np.eye(19)}, f"fit/limbs of shape (19, 19), {LIMBS}"),
        ("no limbs", {"fast": TABLE}, f"fit/limbs of shape (0,), {LIMBS}"),
        ("negative limbs", {"limbs": -np.eye(20)}, f"fit/limbs of shape (20, 20), {LIMBS}"),
        ("NaN limbs", {"limbs": np.eye(20) * np.nan}, f"fit/limbs of shape (20, 20), {LIMBS}"),
        ("poses without a mean", {"limbs": np.eye(20), "poses": np.eye(20)},
         "fit/poses of shape (20, 20), expected a mean and a covariance (21, 20)"),
        ("poses that are all alike", {"limbs": np.eye(20), "poses": np.zeros((21, 20))},
         "fit/poses of shape (21, 20), expected a mean and a covariance (21, 20)"),
        ("no signs", {"limbs": np.eye(20), "fast": TABLE}, f"fit: fast: {SIGNLESS}"),
        ("no table", {"limbs": np.eye(20), "slow.signs": EVEN}, f"fit: slow: {SIGNLESS}"),
        ("descending", {"limbs": np.eye(20), "fast": TABLE[::-1], "fast.signs": EVEN},
         f"fit/fast of shape (3, 3), {ROWS}"),
        ("two columns", {"limbs": np.eye(20), "fast": TABLE[:, :2], "fast.signs": EVEN},
         f"fit/fast of shape (3, 2), {ROWS}"),
        ("no uncertainty", {"limbs": np.eye(20), "fast": ZEROS, "fast.signs": EVEN},
         f"fit/fast of shape (3, 3), {ROWS}"),
        ("negative signs", {"limbs": np.eye(20), "fast": TABLE, "fast.signs": -EVEN},
         "fit/fast.signs of shape (5,), expected 5 weights with the sum 1"),
        ("text", {"limbs": b"text"}, "cannot read the group 'fit': damaged, or not as expected: ..."))
})
def test_files_with_something_wrong(
    model: CapsuleModel, tmp_path: Path, given: dict[str, object], rejected: Any
) -> None:
    """An invalid group ``fit`` raises an error with the name and the shape."""
    with rejected:
        read_errors(write(tmp_path / "w.h5", **given), model)


def test_covariance() -> None:
    """The covariance is about 0, not about the mean, so that a constant error counts."""
    np.testing.assert_allclose(covariance(np.full((5, 2), 0.1)), np.full((2, 2), 0.01))


@given(st.lists(st.tuples(st.floats(1, 1000), st.floats(0, 100)), min_size=2, max_size=200, unique_by=lambda p: p[0]))
def test_a_table_is_ascending(pairs: list[tuple[float, float]]) -> None:
    """Uncertainty and error ascend and the chance descends for any fits; the errors stay within the measured range."""
    uncertainty, error = np.array(pairs).T
    table = table_of(uncertainty, error)
    assert (np.diff(table[:, 0]) > 0).all()
    assert (np.diff(table[:, 1]) >= -1e-9).all() and (np.diff(table[:, 2]) <= 1e-9).all()
    assert error.min() - 1e-9 <= table[:, 1].min() and table[:, 1].max() <= error.max() + 1e-9


def test_crops_that_show_nothing() -> None:
    """Crops with infinite uncertainty do not change the table."""
    uncertainty, error = np.arange(1.0, 101), np.linspace(2, 60, 100)
    shown = table_of(uncertainty, error)
    np.testing.assert_array_equal(table_of(np.append(uncertainty, [np.inf] * 7), np.append(error, [99.0] * 7)), shown)


def test_a_table_of_fits_that_are_known() -> None:
    """The table reproduces errors that grow linearly with the uncertainty."""
    uncertainty = np.random.default_rng(0).uniform(1, 100, 5000)
    errors = NetworkErrors(np.eye(1), {"fast": table_of(uncertainty, 3 + uncertainty / 2)}, {"fast": EVEN})
    _, expected, chance = errors.expected("fast", all_signs([20, 50, 90]))
    np.testing.assert_allclose(expected, [13, 28, 48], atol=0.5)
    assert chance[0] == 1 and chance[2] == 0


def test_the_doubt() -> None:
    """The uncertainty is the weighted geometric mean of 1 + each sign."""
    signs = np.array([[0.0, 3, 8, 0, 0]])
    np.testing.assert_allclose(uncertainty_of(signs, np.array([0, 0.5, 0.5, 0, 0])), [6])


def test_the_sign_that_tells_failures_gets_the_weight() -> None:
    """The weight goes to the sign that predicts failures; no weight is negative; without information all are equal."""
    signs = np.random.default_rng(0).exponential(10, (4000, 5))
    error = np.where(signs[:, 1] > 25, GOOD_MM + 10, 5)
    weights = weights_of(signs, error)
    assert weights[1] > 0.9 and (weights >= 0).all() and weights.sum() == pytest.approx(1)
    for same in (5.0, 50.0):
        np.testing.assert_array_equal(weights_of(signs, np.full(4000, same)), EVEN)
    np.testing.assert_array_equal(weights_of(np.zeros((10, 5)), np.repeat([5.0, 50], 5)), EVEN)
    nothing = np.append(signs, np.full((1, 5), np.inf), axis=0)  # a crop that shows nothing
    np.testing.assert_array_equal(weights_of(nothing, np.append(error, 99)), weights)
