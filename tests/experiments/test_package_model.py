"""experiments/package_model.py: the rounded weights and their file"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

import netlib
from experiments.package_model import rounded, write_model
from handpose.estimate.packaged import HAND_FINDER
from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import NetworkErrors, read_errors
from layers.hand import skeleton


@example(12.0, 0, False)
@given(st.floats(2.0**-100, 2.0**100, width=32), st.integers(0, 23), st.booleans())
def test_rounding(value: float, bits: int, negative: bool) -> None:
    """Mantissas are rounded to nearest, ties to even, as by NumPy's rounding."""
    number = np.float32(-value if negative else value)
    mantissa, exponent = np.frexp(np.float64(number))
    expected = np.ldexp(np.rint(mantissa * 2 ** (bits + 1)), exponent - bits - 1)
    assert rounded(np.array([number]), bits)[0] == np.float32(expected)


def test_zero_stays() -> None:
    """Zeros and the shape are unchanged."""
    np.testing.assert_array_equal(rounded(np.zeros((2, 3), np.float32), 5), np.zeros((2, 3)))


def test_a_model_file(tmp_path: Path) -> None:
    """The file is read back as weights and as the network's errors, and is smaller than its numbers."""
    net = netlib.Net(HAND_FINDER / "deploy.prototxt", netlib.TEST, seed=3)
    for blobs in net.params.values():
        for blob in blobs:
            blob.data[...] = rounded(blob.data, 8)
    errors = NetworkErrors(np.eye(20) * 0.1)
    write_model(net, errors, tmp_path / "x.caffemodel.h5")
    again = netlib.Net(HAND_FINDER / "deploy.prototxt", tmp_path / "x.caffemodel.h5", netlib.TEST)
    for name, blobs in net.params.items():
        for one, other in zip(blobs, again.params[name]):
            np.testing.assert_array_equal(one.data, other.data)
    found = read_errors(tmp_path / "x.caffemodel.h5", CapsuleModel(skeleton.load(), 150.0))
    np.testing.assert_array_equal(found.limbs, errors.limbs)
    numbers = sum(blob.count for blobs in net.params.values() for blob in blobs)
    assert numbers > 10_000
    assert (tmp_path / "x.caffemodel.h5").stat().st_size < 0.7 * 4 * numbers
