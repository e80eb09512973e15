"""handpose/frames/formats/rvl.py: an image compressed by hand, those of a plain encoder, and damage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.formats.rvl import decompress
from tests.support.bags import rvl


def test_an_image_by_hand() -> None:
    """Two zeros, then 3 and 1: the numbers 2, 2, 6 (3) and 3 (-2), one digit each, and 4 digits of padding."""
    assert decompress(np.array([0x22630000], "<u4").tobytes(), 2, 2).tolist() == [[0, 0], [3, 1]]


@given(st.lists(st.sampled_from([0, 0, 1, 500, 501, 65535]), min_size=6, max_size=60))
def test_what_an_encoder_writes(values: list[int]) -> None:
    """Zeros, equal values and steps over the complete range are restored."""
    image = np.array(values[: len(values) // 3 * 3], np.uint16).reshape(-1, 3)
    np.testing.assert_array_equal(decompress(rvl(image), *image.shape), image)


def test_damage() -> None:
    """A cut image, too many pixels, empty runs and numbers without an end raise ValueError."""
    content = rvl(np.arange(1, 25, dtype=np.uint16).reshape(4, 6))
    with pytest.raises(ValueError, match=r"ends (after|beyond)"):
        decompress(content[:-4], 4, 6)
    with pytest.raises(ValueError, match="ends beyond the 12 pixels"):
        decompress(content, 2, 6)
    with pytest.raises(ValueError, match="a run of 0 zeros and 0 values"):
        decompress(b"\0" * 8, 2, 2)
    with pytest.raises(ValueError, match="ends after 0 of 4 pixels"):
        decompress(b"\xff" * 8, 2, 2)
    with pytest.raises(ValueError, match="a number of 9 digits"):
        decompress(b"\xff" * 4 + b"\0" * 4, 2, 2)
