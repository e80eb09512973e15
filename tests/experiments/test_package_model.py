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
@example(1.25, 1, False)
@given(st.floats(2.0**-100, 2.0**100, width=32), st.integers(0, 23), st.booleans())
def test_rounding(value: float, bits: int, negative: bool) -> None:
    """Mantissas are rounded to nearest, ties to even, as by NumPy's rounding; the shape is unchanged."""
    number = np.float32(-value if negative else value)
    mantissa, exponent = np.frexp(np.float64(number))
    expected = np.ldexp(np.rint(mantissa * 2 ** (bits + 1)), exponent - bits - 1)
    np.testing.assert_array_equal(rounded(np.array([[number, 0]]), bits), np.float32([[expected, 0]]))


def test_a_model_file(tmp_path: Path) -> None:
    """The file is read back as weights and as the network's errors, and is smaller than its numbers."""
    net, path = netlib.Net(HAND_FINDER / "deploy.prototxt", netlib.TEST, seed=3), tmp_path / "x.caffemodel.h5"
    for blobs in net.params.values():
        for blob in blobs:
            blob.data[...] = rounded(blob.data, 8)
    errors = NetworkErrors(np.eye(20) * 0.1)
    write_model(net, errors, path)
    again = netlib.Net(HAND_FINDER / "deploy.prototxt", path, netlib.TEST)
    for name, blobs in net.params.items():
        for one, other in zip(blobs, again.params[name]):
            np.testing.assert_array_equal(one.data, other.data)
    np.testing.assert_array_equal(read_errors(path, CapsuleModel(skeleton.load(), 150.0)).limbs, errors.limbs)
    numbers = sum(blob.count for blobs in net.params.values() for blob in blobs)
    assert numbers > 10_000 and path.stat().st_size < 0.7 * 4 * numbers
