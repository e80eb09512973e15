"""handpose/experiments/model_file.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import netlib
from handpose.depth_fit.body import CapsuleModel
from handpose.depth_fit.network_errors import NetworkErrors, read_errors
from handpose.experiments.model_file import rounded, write_model
from handpose.prediction.packaged import HAND_LOCATOR
from layers.hand import skeleton


@given(st.floats(2.0**-100, 2.0**100, width=32), st.integers(0, 23), st.booleans())
def test_rounding(value: float, bits: int, negative: bool) -> None:
    """To the nearest number of so many bits, ties to even: what NumPy's own rounding of the mantissa says."""
    number = np.float32(-value if negative else value)
    mantissa, exponent = np.frexp(np.float64(number))
    expected = np.ldexp(np.rint(mantissa * 2 ** (bits + 1)), exponent - bits - 1)
    assert rounded(np.array([number]), bits)[0] == np.float32(expected)


def test_zero_stays() -> None:
    """And so does a shape."""
    np.testing.assert_array_equal(rounded(np.zeros((2, 3), np.float32), 5), np.zeros((2, 3)))


def test_a_model_file(tmp_path: Path) -> None:
    """Reads back as weights, and as the network's errors; smaller than the numbers."""
    net = netlib.Net(HAND_LOCATOR / "deploy.prototxt", netlib.TEST, seed=3)
    for blobs in net.params.values():
        for blob in blobs:
            blob.data[...] = rounded(blob.data, 8)
    errors = NetworkErrors(np.eye(20) * 0.1, {"fast": np.array([[1.0, 2, 1], [2, 3, 0.5]])},
                           {"fast": np.full(5, 0.2)})  # fmt: skip
    write_model(net, errors, tmp_path / "x.caffemodel.h5")
    again = netlib.Net(HAND_LOCATOR / "deploy.prototxt", tmp_path / "x.caffemodel.h5", netlib.TEST)
    for name, blobs in net.params.items():
        for one, other in zip(blobs, again.params[name]):
            np.testing.assert_array_equal(one.data, other.data)
    found = read_errors(tmp_path / "x.caffemodel.h5", CapsuleModel(skeleton.load(), 150.0))
    np.testing.assert_array_equal(found.limbs, errors.limbs)
    np.testing.assert_array_equal(found.tables["fast"], errors.tables["fast"])
    np.testing.assert_array_equal(found.weights["fast"], errors.weights["fast"])
    numbers = sum(blob.count for blobs in net.params.values() for blob in blobs)
    assert numbers > 10_000
    assert (tmp_path / "x.caffemodel.h5").stat().st_size < 0.7 * 4 * numbers
