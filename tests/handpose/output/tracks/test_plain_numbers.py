"""handpose/output/tracks/plain_numbers.py"""

from __future__ import annotations

import numpy as np

from handpose.output.tracks.plain_numbers import fields_of, rounded, rounded_if_known


def test_unknown_numbers_are_null_and_empty() -> None:
    numbers = np.array([[1.236, np.nan], [-0.001, 2.0]])
    assert rounded(numbers, 2) == [[1.24, None], [0.0, 2.0]]
    assert rounded_if_known(numbers, 2) is None
    assert fields_of(numbers, 2) == ["1.24", "", "-0.00", "2.00"]
