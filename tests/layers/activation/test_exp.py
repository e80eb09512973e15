"""Exp."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "y", "dx"),
    [
        ("", np.exp([0, 1, 2]), np.exp([0, 1, 2])),
        ("base: -1 scale: 2", np.exp([0, 2, 4]), 2 * np.exp([0, 2, 4])),
        ("base: 2", [1, 2, 4], np.log(2) * np.array([1, 2, 4])),
        ("base: 2 scale: 3 shift: 1", [2, 16, 128], 3 * np.log(2) * np.array([2, 16, 128])),
        ("base: 0.5", [1, 0.5, 0.25], -np.log(2) * np.array([1, 0.5, 0.25])),
        ("base: 1", [1, 1, 1], [0, 0, 0]),
    ],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, options, y, dx, in_place):
    """The values are base^(shift + scale x) at 0, 1 and 2."""
    done = run(f'type: "Exp" exp_param {{ {options} }}', [0, 1, 2], in_place=in_place)
    assert np.allclose(done.y, y)
    assert np.allclose(done.backward([1, 1, 1])[0], dx)


def test_too_large_is_infinite(run):
    """Overflow gives infinity without a warning; the solver detects it."""
    assert run('type: "Exp"', [1000.0]).y.tolist() == [np.inf]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences with all three options set."""
    text = 'type: "Exp" exp_param { base: 1.7 scale: 2 shift: 0.5 }'
    check(text, rng.normal(size=(3, 4)), in_place=in_place)
