"""Layers of one value to one value, on numbers worked by hand, in new tops and in place."""

import numpy as np
import pytest

from layers import LAYER_TYPES

LN2, LN3, LN4 = np.log([2, 3, 4])
FAR = [1000.0, -1000.0]  # where an exponential overflows
INF = np.inf

# type and options, x, y, and dx for dy = 1
BY_HAND = [
    ("AbsVal", [-2, 0, 3], [2, 0, 3], [-1, 0, 1]),
    ("BNLL", [0, LN3, -LN3], np.log([2, 4, 4 / 3]), [0.5, 0.75, 0.25]),
    ("BNLL", FAR, [1000, 0], [1, 0]),
    (
        "Clip clip_param { min: -1 max: 2 }",
        [-3, -1, 0.5, 2, 4],
        [-1, -1, 0.5, 2, 2],
        [0, 1, 1, 1, 0],
    ),
    # the lower bound, as in Caffe
    ("Clip clip_param { min: 1 max: -1 }", [-3, 0, 3], [1, 1, 1], [0, 0, 0]),
    ("ELU elu_param { alpha: 1 }", [-LN4, 0, 3], [-0.75, 0, 3], [0.25, 1, 1]),
    ("ELU elu_param { alpha: -2 }", [-LN4, 0, 3], [1.5, 0, 3], [-0.5, -2, 1]),
    ("ELU", FAR, [1000, -1], [1, 0]),
    ("Exp", [0, 1, 2], np.exp([0, 1, 2]), np.exp([0, 1, 2])),
    ("Exp exp_param { base: -1 scale: 2 }", [0, 1, 2], np.exp([0, 2, 4]), 2 * np.exp([0, 2, 4])),
    (
        "Exp exp_param { base: 2 scale: 3 shift: 1 }",
        [0, 1, 2],
        [2, 16, 128],
        3 * LN2 * np.array([2, 16, 128]),
    ),
    ("Exp exp_param { base: 0.5 }", [0, 1, 2], [1, 0.5, 0.25], -LN2 * np.array([1, 0.5, 0.25])),
    ("Exp exp_param { base: 1 }", [0, 1, 2], [1, 1, 1], [0, 0, 0]),
    ("Exp", [1000], [INF], [INF]),  # without a warning; the solver detects it
    ("Log", [1, 2, 4], np.log([1, 2, 4]), [1, 0.5, 0.25]),
    ("Log log_param { base: 0.5 }", [1, 2, 4], [0, -1, -2], np.array([-1, -0.5, -0.25]) / LN2),
    (
        "Log log_param { base: -1 scale: 2 shift: 1 }",
        [1, 2, 4],
        np.log([3, 5, 9]),
        [2 / 3, 2 / 5, 2 / 9],
    ),
    (
        "Log log_param { base: 10 scale: 3 shift: -2 }",
        [1, 2, 4],
        np.log10([1, 4, 10]),
        3 / np.log(10) / np.array([1, 4, 10]),
    ),
    ("Log", [0, -1], [-INF, np.nan], [INF, -1]),
    ("Power", [1, 2, 4], [1, 2, 4], [1, 1, 1]),
    ("Power power_param { scale: 2 shift: 1 }", [1, 2, 4], [3, 5, 9], [2, 2, 2]),
    ("Power power_param { power: 2 }", [1, 2, 4], [1, 4, 16], [2, 4, 8]),
    ("Power power_param { power: -1 }", [1, 2, 4], [1, 0.5, 0.25], [-1, -0.25, -1 / 16]),
    (
        "Power power_param { power: 0.5 }",
        [1, 2, 4],
        [1, np.sqrt(2), 2],
        [0.5, 0.5 / np.sqrt(2), 0.25],
    ),
    ("Power power_param { power: 2 scale: 3 shift: -1 }", [1, 2, 4], [4, 25, 121], [12, 30, 66]),
    ("Power power_param { power: 0 }", [0, 1, 2], [1, 1, 1], [0, 0, 0]),
    ("Power power_param { scale: 0 shift: 3 }", [1, 2, 4], [3, 3, 3], [0, 0, 0]),
    ("ReLU", [-2, 0, 3], [0, 0, 3], [0, 0, 1]),
    ("ReLU relu_param { negative_slope: 0.25 }", [-2, 0, 3], [-0.5, 0, 3], [0.25, 0.25, 1]),
    ("ReLU relu_param { negative_slope: 2 }", [-2, 0, 3], [-4, 0, 3], [2, 2, 1]),
    ("ReLU6", [-2, 0, 3, 6, 8], [0, 0, 3, 6, 6], [0, 0, 1, 0, 0]),
    (
        "ReLU6 relu6_param { negative_slope: 0.25 }",
        [-2, 0, 0.5, 6, 8],
        [-0.5, 0, 0.5, 6, 6],
        [0.25, 0.25, 1, 0, 0],
    ),
    ("ReLU6 relu6_param { negative_slope: -2 }", [-4, -2, 4, 8], [6, 4, 4, 6], [0, -2, 1, 0]),
    ("Sigmoid", [0, LN4, -LN4], [0.5, 0.8, 0.2], [0.25, 0.16, 0.16]),
    ("Sigmoid", FAR, [1, 0], [0, 0]),
    ("Swish", [0, LN4], [0, 0.8 * LN4], [0.5, 0.8 + LN4 * 0.8 * 0.2]),
    ("Swish swish_param { beta: 2 }", [0, LN2], [0, 0.8 * LN2], [0.5, 0.8 + 2 * LN2 * 0.8 * 0.2]),
    ("Swish", FAR, [1000, 0], [1, 0]),
    ("TanH", [0, LN2, -LN2], [0, 0.6, -0.6], [1, 0.64, 0.64]),
    ("TanH", FAR, [1, -1], [0, 0]),
    ("Threshold", [-1, 0, 0.5, 2], [0, 0, 1, 1], None),
    ("Threshold threshold_param { threshold: 0.5 }", [-1, 0, 0.5, 2], [0, 0, 0, 1], None),
]


@pytest.mark.parametrize(("layer", "x", "y", "dx"), BY_HAND)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, layer, x, y, dx, in_place):
    kind, _, options = layer.partition(" ")
    if in_place and (not LAYER_TYPES[kind].in_place or "negative_slope: -" in options):
        pytest.skip("backward reads the bottom")
    done = run(f'type: "{kind}" {options}', x, in_place=in_place)
    np.testing.assert_allclose(done.y, y, atol=1e-15)
    if dx is not None:
        np.testing.assert_allclose(done.backward(np.ones(len(x)))[0], dx, atol=1e-15)


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
