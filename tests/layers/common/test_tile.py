"""Tile."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


def test_by_hand(run):
    """The row is repeated as a whole; the gradients of the copies are added."""
    done = run('type: "Tile" tile_param { tiles: 2 }', [[1.0, 2], [3, 4]])
    assert done.y.tolist() == [[1, 2, 1, 2], [3, 4, 3, 4]]
    assert done.backward([[1, 2, 10, 20], [3, 4, 30, 40]])[0].tolist() == [[11, 22], [33, 44]]


@pytest.mark.parametrize(("axis", "shape"), [(0, (6, 3, 4)), (1, (2, 9, 4)), (2, (2, 3, 12)), (-3, (6, 3, 4))])
def test_any_axis(run, check, rng, axis, shape):
    """Tiling along any axis equals numpy.tile."""
    x = rng.normal(size=(2, 3, 4))
    text = f'type: "Tile" tile_param {{ axis: {axis} tiles: 3 }}'
    done = run(text, x)
    repeats = [1, 1, 1]
    repeats[axis] = 3
    assert np.array_equal(done.y, np.tile(x, repeats))
    assert done.y.shape == shape
    check(text, x)


def test_tiles_of_nothing(run):
    """Tiling an empty blob takes no time or memory."""
    assert run('type: "Tile" tile_param { tiles: 2147483647 }', np.zeros((0, 1))).y.shape == (0, 2147483647)
