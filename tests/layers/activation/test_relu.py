"""ReLU."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines

LEAKY = 'type: "ReLU" relu_param { negative_slope: 0.25 }'


@pytest.mark.parametrize(
    ("text", "y", "dx"),
    [('type: "ReLU"', [0, 0, 3], [0, 0, 5]), (LEAKY, [-0.5, 0, 3], [1.25, 1.25, 5])],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, text, y, dx, in_place):
    """The values agree at -2, 0 and 3; at 0 the gradient is that of the negative side."""
    done = run(text, [-2, 0, 3], in_place=in_place)
    assert done.y.tolist() == y
    assert done.backward([5, 5, 5])[0].tolist() == dx


@pytest.mark.parametrize("shape", [(), (1,), (0, 20_000), (3, 5), (2, 1 << 14), (3, (1 << 14) + 5), (5, 7, 1000)])
def test_any_size_and_order(run, rng, shape):
    """Long rows, odd sizes and scalars give the same values, although they are computed in different ways."""
    x, dy = rng.normal(size=shape), rng.normal(size=shape)
    done = run('type: "ReLU"', x)
    assert np.array_equal(done.y, np.maximum(x, 0))
    assert np.array_equal(done.backward(dy)[0], dy * (x > 0))


@pytest.mark.parametrize("slope", [0, 0.25, -0.5])
def test_gradient(check, rng, slope):
    """The gradient agrees with differences away from the kink."""
    x = rng.choice([-1, 1], (3, 4)) * rng.uniform(0.1, 1, (3, 4))
    text = f'type: "ReLU" relu_param {{ negative_slope: {slope} }}'
    check(text, x)
    if slope >= 0:
        check(text, x, in_place=True)
