"""Power."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "y", "dx"),
    [
        ("", [1, 2, 4], [1, 1, 1]),
        ("scale: 2 shift: 1", [3, 5, 9], [2, 2, 2]),
        ("power: 2", [1, 4, 16], [2, 4, 8]),
        ("power: -1", [1, 0.5, 0.25], [-1, -0.25, -1 / 16]),
        ("power: 0.5", [1, np.sqrt(2), 2], [0.5, 0.5 / np.sqrt(2), 0.25]),
        ("power: 2 scale: 3 shift: -1", [4, 25, 121], [12, 30, 66]),
        ("power: 0", [1, 1, 1], [0, 0, 0]),
        ("scale: 0 shift: 3", [3, 3, 3], [0, 0, 0]),
    ],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, options, y, dx, in_place):
    """The values are (shift + scale x)^power at 1, 2 and 4."""
    done = run(f'type: "Power" power_param {{ {options} }}', [1, 2, 4], in_place=in_place)
    assert np.allclose(done.y, y)
    assert np.allclose(done.backward([1, 1, 1])[0], dx)


def test_a_constant_has_no_gradient_at_0(run):
    """Power 0 gives 1 everywhere with gradient 0, also at x = 0."""
    done = run('type: "Power" power_param { power: 0 }', [0.0, 1])
    assert done.y.tolist() == [1, 1]
    assert done.backward([1, 1])[0].tolist() == [0, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences for a positive base."""
    text = 'type: "Power" power_param { power: 1.7 scale: 2 shift: 0.5 }'
    check(text, rng.uniform(0.1, 1, (3, 4)), in_place=in_place)
