"""handpose/fit/network_errors.py"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import (
    POSE_STD,
    UNKNOWN_STD,
    NetworkErrors,
    Poses,
    arrays_of,
    covariance,
    read_errors,
)
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5


def write(path: Path, **arrays: object) -> Path:
    """A file with a group ``fit``."""
    return write_hdf5(
        path, **{f"fit/{name}": values for name, values in arrays.items()}, **{"data/ip": 0}
    )


def test_natural_poses(rng: np.random.Generator) -> None:
    """Mean and covariance of poses; a limb that never moves keeps the covariance invertible."""
    limbs = rng.normal(0.5, 0.2, (1000, 20))
    limbs[:, 7] = 0.1
    poses = Poses.of(limbs)
    assert_allclose(poses.mean, limbs.mean(axis=0))
    assert_allclose(poses.covariance, np.cov(limbs.T, bias=True) + np.eye(20) * POSE_STD**2)


@pytest.mark.parametrize(
    "poses", [None, Poses(np.linspace(0.1, 0.5, 20), np.diag(np.linspace(1.0, 2.0, 20)))]
)
def test_stored_errors_are_read_back(model: CapsuleModel, here: Path, poses: Poses | None) -> None:
    """Other arrays, such as the tables of files of earlier versions, are not read."""
    errors = NetworkErrors(np.eye(20) * 0.04, poses)
    found = read_errors(write("w.h5", **arrays_of(errors), fast=np.ones((3, 3))), model)
    assert found.is_measured and (found.poses is None) == (poses is None)
    assert_array_equal(found.limbs, errors.limbs)
    for one, other in zip(found.poses or (), poses or ()):
        assert_array_equal(one, other)


def test_unmeasured_weights_get_a_default_spread(model: CapsuleModel, here: Path) -> None:
    """Caffe's weights, and those of another format, are not measured."""
    with h5py.File("w.h5", "w") as file:
        file.create_group("data")
    Path("binary.caffemodel").write_bytes(b"\x0a\x03abc")
    for name in ("w.h5", "binary.caffemodel"):
        found = read_errors(name, model)
        assert_allclose(found.limbs, np.eye(20) * UNKNOWN_STD**2)
        assert not found.is_measured


LIMBS = "expected a covariance (20, 20)"


@bad_inputs(
    DataError,
    {
        name: (arrays, f"...w.h5: {line}")
        for name, arrays, line in (
            ("19 limbs", {"limbs": np.eye(19)}, f"fit/limbs of shape (19, 19), {LIMBS}"),
            ("no limbs", {"poses": np.eye(21)}, f"fit/limbs of shape (0,), {LIMBS}"),
            ("negative limbs", {"limbs": -np.eye(20)}, f"fit/limbs of shape (20, 20), {LIMBS}"),
            ("NaN limbs", {"limbs": np.eye(20) * np.nan}, f"fit/limbs of shape (20, 20), {LIMBS}"),
            (
                "poses without a mean",
                {"limbs": np.eye(20), "poses": np.eye(20)},
                "fit/poses of shape (20, 20), expected a mean and a covariance (21, 20)",
            ),
            (
                "poses that are all alike",
                {"limbs": np.eye(20), "poses": np.zeros((21, 20))},
                "fit/poses of shape (21, 20), expected a mean and a covariance (21, 20)",
            ),
            (
                "text",
                {"limbs": b"text"},
                "cannot read the group 'fit': damaged, or not as expected: ...",
            ),
        )
    },
)
def test_invalid_groups_are_rejected(
    model: CapsuleModel, here: Path, given: dict[str, object], rejected: Any
) -> None:
    """An invalid group ``fit`` raises an error with the name and the shape."""
    with rejected:
        read_errors(write("w.h5", **given), model)


def test_covariance() -> None:
    """The covariance is about 0, not about the mean, so that a constant error counts."""
    assert_allclose(covariance(np.full((5, 2), 0.1)), np.full((2, 2), 0.01))
