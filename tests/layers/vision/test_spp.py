"""SPP: levels, windows, and maps that do not fit."""

import math

import numpy as np
import pytest


def text(height, pool="MAX"):
    return f'type: "SPP" spp_param {{ pyramid_height: {height} pool: {pool} }}'


def test_by_hand(run):
    """The outputs are the whole map, then its quarters, channel by channel within each level."""
    x = np.array([[1.0, 2, 3, 4], [5, 6, 7, 8]]).reshape(1, 1, 2, 4)
    x = np.concatenate([x, 10 * x], axis=1)
    assert run(text(2), x).y.tolist() == [[8, 80, 2, 4, 6, 8, 20, 40, 60, 80]]
    done = run(text(2, "AVE"), x[:, :1])
    assert done.y.tolist() == [[4.5, 1.5, 3.5, 5.5, 7.5]]
    assert done.backward([[8, 2, 0, 0, 4]])[0].tolist() == [[[[2, 2, 1, 1], [1, 1, 3, 3]]]]


def test_the_first_of_equal_values_wins(run):
    assert run(text(2), np.zeros((1, 1, 2, 2))).backward([[1, 2, 3, 4, 5]])[0].tolist() == [[[[3, 3], [4, 5]]]]


def test_a_single_level_keeps_four_axes(run):
    """A single level keeps four axes, as in Caffe; several levels are flattened."""
    assert run(text(1), np.ones((2, 3, 4, 5))).y.shape == (2, 3, 1, 1)
    assert run(text(3), np.ones((2, 3, 4, 4))).y.shape == (2, 3 * (1 + 4 + 16))


def pooled(run, x, level, pool):
    """Compute a level as a Pooling layer with the window and padding of Caffe's SPP layer."""
    options = f"pool: {pool}"
    for side, size in zip("hw", x.shape[2:]):
        k = math.ceil(size / 2**level)
        pad = (k * 2**level - size + 1) // 2
        options += f" kernel_{side}: {k} stride_{side}: {k} pad_{side}: {pad}"
    return run(f'type: "Pooling" pooling_param {{ {options} }}', x)


@pytest.mark.parametrize("pool", ["MAX", "AVE"])
@pytest.mark.parametrize("size", [(4, 8), (7, 11), (13, 6), (10, 10)], ids=str)
def test_levels_are_poolings(run, rng, size, pool):
    """Values and gradients of each level equal those of Pooling, also with windows that extend over the edges."""
    x = rng.integers(0, 5, (2, 3, *size)).astype(float)
    done = run(text(3, pool), x)
    levels = [pooled(run, x, level, pool) for level in range(3)]
    assert np.allclose(done.y, np.concatenate([level.y.reshape(2, -1) for level in levels], axis=1))
    dy = rng.normal(size=done.y.shape)
    ends = np.cumsum([level.y[0].size for level in levels])[:-1]
    parts = [part.reshape(level.y.shape) for part, level in zip(np.split(dy, ends, axis=1), levels)]
    assert np.allclose(done.backward(dy)[0], sum(level.backward(part)[0] for part, level in zip(parts, levels)))
