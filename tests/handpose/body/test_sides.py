"""handpose/body/sides.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body.sides import MIRROR, SIDES, as_right, mirror_of


def test_mirror() -> None:
    """The mirror negates x for left hands only, and is its own inverse."""
    assert mirror_of("left") is MIRROR and MIRROR.tolist() == [-1, 1, 1]
    for side in SIDES:
        np.testing.assert_array_equal(mirror_of(side) ** 2, np.ones(3))


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4)])
def test_images(shape: tuple[int, ...]) -> None:
    """For left hands the columns are reversed, in one image and in several."""
    images = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    np.testing.assert_array_equal(as_right(images, "right"), images)
    np.testing.assert_array_equal(as_right(images, "left"), np.flip(images, -1))
