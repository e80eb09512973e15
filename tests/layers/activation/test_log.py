"""Log."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "y", "dx"),
    [
        ("", np.log([1, 2, 4]), [1, 0.5, 0.25]),
        ("base: 2", [0, 1, 2], np.array([1, 0.5, 0.25]) / np.log(2)),
        ("base: 0.5", [0, -1, -2], np.array([-1, -0.5, -0.25]) / np.log(2)),
        ("base: -1 scale: 2 shift: 1", np.log([3, 5, 9]), [2 / 3, 2 / 5, 2 / 9]),
        ("base: 10 scale: 3 shift: -2", np.log10([1, 4, 10]), 3 / np.log(10) / np.array([1, 4, 10])),
    ],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, options, y, dx, in_place):
    """The values are the logarithm of shift + scale x at 1, 2 and 4."""
    done = run(f'type: "Log" log_param {{ {options} }}', [1, 2, 4], in_place=in_place)
    assert np.allclose(done.y, y)
    assert np.allclose(done.backward([1, 1, 1])[0], dx)


def test_what_has_no_logarithm(run):
    """Zero gives -infinity and a negative number NaN, as in Caffe, without a warning; the solver detects them."""
    assert np.array_equal(run('type: "Log"', [0.0, -1]).y, [-np.inf, np.nan], equal_nan=True)


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences with all three options set."""
    text = 'type: "Log" log_param { base: 1.7 scale: 2 shift: 0.5 }'
    check(text, rng.uniform(0.1, 1, (3, 4)), in_place=in_place)
