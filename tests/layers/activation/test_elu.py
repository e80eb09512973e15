"""ELU."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("in_place", [False, True])
@pytest.mark.parametrize("alpha", [1, 0.5, -2])
def test_by_hand(run, alpha, in_place):
    """At 0 the slope is that of the negative side, for any alpha and in place."""
    done = run(f'type: "ELU" elu_param {{ alpha: {alpha} }}', [-np.log(4), 0, 3], in_place=in_place)
    assert np.allclose(done.y, [-0.75 * alpha, 0, 3])
    assert np.allclose(done.backward([4, 4, 4])[0], [alpha, 4 * alpha, 4])


def test_far_out(run):
    """The values approach -alpha on the negative side and do not overflow on the positive side."""
    done = run('type: "ELU"', [-1000.0, 1000.0])
    assert done.y.tolist() == [-1, 1000]
    assert done.backward([1, 1])[0].tolist() == [0, 1]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences away from the kink of an alpha other than 1."""
    x = rng.choice([-1, 1], (3, 4)) * rng.uniform(0.1, 1, (3, 4))
    check('type: "ELU" elu_param { alpha: 0.3 }', x, in_place=in_place)
