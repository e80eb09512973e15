"""ShuffleChannel."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


def text(group):
    return f'type: "ShuffleChannel" shuffle_channel_param {{ group: {group} }}'


def test_by_hand(run):
    """The first channels of all groups come first, then the second ones."""
    x = np.arange(6.0).reshape(1, 6, 1, 1)
    done = run(text(2), x)
    assert done.y.ravel().tolist() == [0, 3, 1, 4, 2, 5]
    assert done.backward(10 * done.y)[0].ravel().tolist() == [0, 10, 20, 30, 40, 50]
    assert run(text(3), x).y.ravel().tolist() == [0, 2, 4, 1, 3, 5]


def test_one_group_and_one_channel_per_group_change_nothing(run, rng):
    x = rng.normal(size=(2, 4, 3))
    for layer in ('type: "ShuffleChannel"', text(1), text(4)):
        assert np.array_equal(run(layer, x).y, x)


@pytest.mark.parametrize("shape", [(2, 6), (2, 6, 3), (2, 6, 2, 3), (1, 6, 2, 1, 2), (0, 6, 2, 2)], ids=str)
def test_any_number_of_axes(run, rng, shape):
    """Shuffling with G and then with C / G groups is the identity, for items, rows and columns of any number."""
    x = rng.normal(size=shape)
    assert np.array_equal(run(text(3), run(text(2), x).y).y, x)
