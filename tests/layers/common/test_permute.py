"""Permute."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


def text(*order):
    return f'type: "Permute" permute_param {{ {" ".join(f"order: {axis}" for axis in order)} }}'


def test_by_hand(run):
    """The numbers of one position become neighbours: y[n, h, w, c] = x[n, c, h, w]."""
    done = run(text(0, 2, 3, 1), [[[[1, 2, 3]], [[4, 5, 6]]]])
    assert done.y.tolist() == [[[[1, 4], [2, 5], [3, 6]]]]
    assert done.backward([[[[1, 2], [3, 4], [5, 6]]]])[0].tolist() == [[[[1, 3, 5]], [[2, 4, 6]]]]


@pytest.mark.parametrize(
    ("order", "axes"), [((), (0, 1, 2, 3)), ((2,), (2, 0, 1, 3)), ((3, 1), (3, 1, 0, 2)), ((3, 2, 1, 0),) * 2], ids=str
)
def test_axes_without_a_place_follow_in_sequence(run, rng, order, axes):
    """Axes that the order does not name follow; without an order y = x."""
    x = rng.normal(size=(2, 3, 4, 5))
    done = run(text(*order), x)
    assert np.array_equal(done.y, np.moveaxis(x, axes, range(4)))
    dy = rng.normal(size=done.y.shape)
    assert np.array_equal(done.backward(dy)[0], np.moveaxis(dy, range(4), axes))
