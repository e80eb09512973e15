"""handpose/synthetic/places.py"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from handpose.data.places import CUBE_MM, SIZE
from handpose.synthetic.generator import BLOCK
from handpose.synthetic.many import generate
from handpose.synthetic.places import FAR_MM, NEAR_MM, NOBODY, PlaceGenerator, PlaceRows
from netlib.errors import DataError


@pytest.fixture(scope="module")
def block() -> PlaceRows:
    """Places of four scenes."""
    return PlaceGenerator(3).block(1)


def test_labels(block: PlaceRows) -> None:
    """Hands that are near, with their offsets; none where none is; neither where one is half near."""
    hand, offset = block.hand, np.linalg.norm(block.offset, axis=1) * CUBE_MM / 2
    assert {0.0, 1.0} <= set(hand.tolist()) <= {0.0, 1.0, NOBODY}
    assert 0.3 < (hand == 1).mean() < 0.7
    assert (offset[hand == 1] < NEAR_MM).all() and (offset[hand == 1] > 0).all() and (offset[hand != 1] == 0).all()
    np.testing.assert_array_equal(block.near, np.repeat((hand == 1)[:, None], 3, axis=1))
    assert NEAR_MM < FAR_MM
    assert block.depth.shape == (BLOCK, 1, SIZE, SIZE) and np.abs(block.depth).max() <= 1


def test_a_hand_is_where_the_offset_says(block: PlaceRows) -> None:
    """Something is seen there, at about that depth."""
    close = 0
    for depth, offset in zip(block.depth[:, 0], block.offset):
        if offset.any():
            column, row = (np.array([offset[0], -offset[1]]) * SIZE / 2 + SIZE / 2).astype(int)
            around = depth[max(row - 4, 0) : row + 5, max(column - 4, 0) : column + 5]
            close += np.abs(around - offset[2]).min() * CUBE_MM / 2 < 60
    assert close / (block.hand == 1).sum() > 0.9


def test_the_same_places(block: PlaceRows) -> None:
    """For the same numbers, in another process too; other ones for another seed or split."""
    generator = pickle.loads(pickle.dumps(PlaceGenerator(3)))
    for name, values in generator.block(1).arrays().items():
        np.testing.assert_array_equal(values, getattr(block, name))
    assert not np.array_equal(PlaceGenerator(3, "test").block(1).depth, block.depth)
    assert generator.made_from() != PlaceGenerator(4).made_from()
    assert block.index.tolist() == list(range(BLOCK, 2 * BLOCK))


def test_a_few_of_them(block: PlaceRows) -> None:
    """In pieces, with the columns that a file will have."""
    (few,) = generate(3, PlaceGenerator(3), start=BLOCK)
    np.testing.assert_array_equal(few.depth, block.depth[:3])
    columns = PlaceGenerator(3).columns()
    for name, values in few.arrays().items():
        assert columns[name].dtype == values.dtype and columns[name].shape == (0, *values.shape[1:])


def test_a_seed_below_zero() -> None:
    """One line."""
    with pytest.raises(DataError, match="seed -1, expected 0 or more"):
        PlaceGenerator(-1)
