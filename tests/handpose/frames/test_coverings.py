"""handpose/frames/coverings.py: what is in front of an expected surface"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.frames.coverings import covering

HALF, PIXEL = 150.0, 1.5  # mm
ROW, COLUMN = np.indices((128, 128))
RELIEF = (8 * np.sin(ROW / 5) * np.cos(COLUMN / 6)).astype(np.float32)  # mm, as of a hand
HAND = (abs(ROW - 64) < 40) & (abs(COLUMN - 64) < 25)
LEFT = HAND & (COLUMN < 60)


def crop(mm: np.ndarray, where: np.ndarray = HAND) -> np.ndarray:
    """A crop of a surface at these distances from the cube's middle."""
    return np.where(where, mm / HALF, 1.0).astype(np.float32)


@pytest.mark.parametrize("flat", [True, False])
def test_an_object_in_front(flat: bool) -> None:
    """What ends at depth steps is apart; only what has no relief is flat."""
    seen = np.where(LEFT, -60 + (0 if flat else 2) * RELIEF, RELIEF)
    found = covering(crop(seen), crop(RELIEF), HALF, PIXEL)
    np.testing.assert_array_equal(found.apart, LEFT)
    assert found.flat == pytest.approx(LEFT.sum() / HAND.sum() if flat else 0, abs=0.02)


def test_beyond_the_outline() -> None:
    """An object is followed a little beyond the expected outline."""
    wide = (abs(ROW - 64) < 30) & (COLUMN < 60)
    seen = crop(np.where(wide, -60 + 2 * RELIEF, RELIEF), HAND | wide)
    apart = covering(seen, crop(RELIEF), HALF, PIXEL).apart
    assert apart[wide & HAND].all() and apart[wide & (COLUMN > 30)].all() and not apart[~wide].any()


def test_a_part_of_the_hand() -> None:
    """A part of the hand that is bent towards the camera continues its surface, so it is not apart."""
    bent = RELIEF - 2 * np.maximum(40 - COLUMN, 0) - 1.5 * np.maximum(60 - COLUMN, 0)
    found = covering(crop(bent), crop(RELIEF), HALF, PIXEL)
    assert not found.apart.any() and not found.flat


def test_nothing_in_front() -> None:
    """The expected surface itself, what is behind it, and an empty crop cover nothing."""
    for mm in (RELIEF, RELIEF + 50):
        assert not covering(crop(mm), crop(RELIEF), HALF, PIXEL).apart.any()
    nothing = covering(np.ones_like(RELIEF), np.ones_like(RELIEF), HALF, PIXEL)
    assert not nothing.apart.any() and nothing.flat == 0
