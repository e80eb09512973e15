"""handpose/frames/formats/rvl.py: an image compressed by hand, those of a plain encoder, and damage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.formats.rvl import decompress
from tests.support.bad_input import bad_inputs
from tests.support.bags import rvl


def test_an_image_by_hand() -> None:
    """Two zeros, then 3 and 1: the numbers 2, 2, 6 (3) and 3 (-2), one digit each, and 4 digits of padding."""
    assert decompress(np.array([0x22630000], "<u4").tobytes(), 2, 2).tolist() == [[0, 0], [3, 1]]


@given(st.lists(st.sampled_from([0, 0, 1, 500, 501, 65535]), min_size=6, max_size=60))
def test_what_an_encoder_writes(values: list[int]) -> None:
    """Zeros, equal values and steps over the complete range are restored."""
    image = np.array(values[: len(values) // 3 * 3], np.uint16).reshape(-1, 3)
    np.testing.assert_array_equal(decompress(rvl(image), *image.shape), image)


IMAGE = rvl(np.arange(1, 25, dtype=np.uint16).reshape(4, 6))


@bad_inputs(ValueError, {
    "cut": (lambda: decompress(IMAGE[:-4], 4, 6), "RVL: a run of 0 zeros and 24 values ends beyond the 24 pixels"),
    "too many pixels": (lambda: decompress(IMAGE, 2, 6), "RVL: ... 0 zeros and 24 values ends beyond the 12 pixels"),
    "empty runs": (lambda: decompress(b"\0" * 8, 2, 2), "RVL: a run of 0 zeros and 0 values ends beyond the 4 pixels"),
    "too few pixels": (lambda: decompress(b"\xff" * 8, 2, 2), "RVL: ends after 0 of 4 pixels"),
    "a number without an end": (lambda: decompress(b"\xff" * 4 + b"\0" * 4, 2, 2),
                                "RVL: a number of 9 digits; expected at most 7"),
})
def test_damage(given: Callable[[], object], rejected: Any) -> None:
    """A cut image, too many pixels, empty runs and numbers without an end raise ValueError."""
    with rejected:
        given()
