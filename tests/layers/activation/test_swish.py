"""Swish."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines

BETA_2 = 'type: "Swish" swish_param { beta: 2 }'


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """The values agree where the sigmoid is 1/2 and 4/5."""
    one, two = np.log(4), np.log(4) / 2
    done = run('type: "Swish"', [0, one], in_place=in_place)
    assert np.allclose(done.y, [0, 0.8 * one])
    assert np.allclose(done.backward([1, 1])[0], [0.5, 0.8 + one * 0.8 * 0.2])
    done = run(BETA_2, [0, two], in_place=in_place)
    assert np.allclose(done.y, [0, 0.8 * two])
    assert np.allclose(done.backward([1, 1])[0], [0.5, 0.8 + 2 * two * 0.8 * 0.2])


def test_far_out(run):
    """Far from 0 the layer equals a ReLU, without overflow."""
    done = run('type: "Swish"', [1000.0, -1000.0])
    assert done.y.tolist() == [1000, 0]
    assert done.backward([1, 1])[0].tolist() == [1, 0]


@pytest.mark.parametrize("text", ['type: "Swish"', BETA_2])
@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, text, in_place):
    """The gradient agrees with differences."""
    check(text, rng.normal(size=(3, 4)), in_place=in_place)
