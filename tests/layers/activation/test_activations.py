"""Layers of one value to one value, in new tops and in place."""

import numpy as np
import pytest

LN2, LN4 = np.log([2, 4])

# type and options, x, y, and dx for dy = 1
BY_HAND = [
    ("Exp exp_param { base: -1 scale: 2 }", [0, 1, 2], np.exp([0, 2, 4]), 2 * np.exp([0, 2, 4])),
    (
        "Exp exp_param { base: 2 scale: 3 shift: 1 }",
        [0, 1, 2],
        [2, 16, 128],
        3 * LN2 * np.array([2, 16, 128]),
    ),
    ("Exp exp_param { base: 0.5 }", [0, 1, 2], [1, 0.5, 0.25], -LN2 * np.array([1, 0.5, 0.25])),
    ("Log log_param { base: 0.5 }", [1, 2, 4], [0, -1, -2], np.array([-1, -0.5, -0.25]) / LN2),
    (
        "Log log_param { base: 10 scale: 3 shift: -2 }",
        [1, 2, 4],
        np.log10([1, 4, 10]),
        3 / np.log(10) / np.array([1, 4, 10]),
    ),
    ("Swish", [0, LN4], [0, 0.8 * LN4], [0.5, 0.8 + LN4 * 0.8 * 0.2]),
    ("Swish swish_param { beta: 2 }", [0, LN2], [0, 0.8 * LN2], [0.5, 0.8 + 2 * LN2 * 0.8 * 0.2]),
]


@pytest.mark.parametrize(("layer", "x", "y", "dx"), BY_HAND)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(by_hand, layer, x, y, dx, in_place):
    by_hand(layer, [x], [y], [np.ones(len(x))], [dx], in_place=in_place)


@pytest.mark.parametrize(("kind", "most"), [("ReLU", np.inf), ("ReLU6", 6)])
@pytest.mark.parametrize(
    "shape", [(), (1,), (0, 20_000), (3, 5), (2, 1 << 14), (3, (1 << 14) + 5), (5, 7, 1000)]
)
def test_any_size_and_order(run, rng, kind, most, shape):
    """Long rows, odd sizes and scalars give the same values, although they are computed in
    different ways.
    """
    x, dy = rng.normal(3, 5, size=shape), rng.normal(size=shape)
    done = run(f'type: "{kind}"', x)
    assert np.array_equal(done.y, np.clip(x, 0, most))
    assert np.array_equal(done.backward(dy)[0], dy * (x > 0) * (x < most))
