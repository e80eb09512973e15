"""Frames compared."""

import numpy as np

from handpose.data.frames import Frames


def assert_equal(one: Frames, two: Frames) -> None:
    """Every array is the same."""
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, two.arrays()[name], name)
