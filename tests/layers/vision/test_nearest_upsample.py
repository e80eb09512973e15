"""Upsample without a mask."""

import numpy as np
import pytest

from fast.traits import traits_of


def text(options):
    return f'type: "Upsample" upsample_param {{ {options} }}'


def test_by_hand(run):
    """Each pixel becomes a square, whose gradients are added."""
    done = run(text("scale: 2"), [[[[1.0, 2], [3, 4]]]])
    assert done.y.tolist() == [[[[1, 1, 2, 2], [1, 1, 2, 2], [3, 3, 4, 4], [3, 3, 4, 4]]]]
    assert done.backward(np.arange(16.0).reshape(1, 1, 4, 4))[0].tolist() == [[[[10, 18], [42, 50]]]]


def test_the_default_scale_is_1(run, rng):
    """Without options the top equals the bottom."""
    x = rng.normal(size=(2, 3, 4, 5))
    assert np.array_equal(run('type: "Upsample"', x).y, x)


@pytest.mark.parametrize("shape", [(2, 3), (2, 2, 3), (2, 1, 2, 3), (0, 3, 2, 2)], ids=str)
def test_any_number_of_axes(run, rng, shape):
    """The last two axes are repeated."""
    x = rng.normal(size=shape)
    assert np.array_equal(run(text("scale: 3"), x).y, x.repeat(3, axis=-1).repeat(3, axis=-2))


def test_it_runs_in_slices(run):
    """The fast engine runs it in slices of the batch with its neighbours."""
    assert traits_of(run(text("scale: 3"), np.zeros((1, 1, 2, 2))).layer).batchwise
