"""Comparison of frames."""

import numpy as np

from handpose.datasets.frames import Frames


def assert_equal(one: Frames, two: Frames) -> None:
    """Assert that all arrays are equal."""
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, two.arrays()[name], name)
