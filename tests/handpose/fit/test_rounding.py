"""handpose/fit/rounding.py"""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from handpose.fit.rounding import FIT_STEP, NETWORK_STEP, PLACE_STEP_MM, rounded


def test_rounded(rng: np.random.Generator) -> None:
    """Values are rounded to multiples of the step, and rounding again does not change them."""
    assert_array_equal(rounded([0.1, -0.1, 0.13, 7], 0.25), [0, 0, 0.25, 7])
    values = rng.normal(size=100).astype(np.float32)
    for step in (FIT_STEP, NETWORK_STEP, PLACE_STEP_MM):
        once = rounded(values, step)
        assert once.dtype == np.float64 and np.abs(once - values).max() <= step / 2
        assert_array_equal(rounded(once, step), once)
