"""Clip."""

import pytest

pytestmark = pytest.mark.both_engines

CLIP = 'type: "Clip" clip_param { min: -1 max: 2 }'


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """At the bounds themselves the gradient passes."""
    done = run(CLIP, [-3, -1, 0.5, 2, 4], in_place=in_place)
    assert done.y.tolist() == [-1, -1, 0.5, 2, 2]
    assert done.backward([5] * 5)[0].tolist() == [0, 5, 5, 5, 0]


def test_bounds_in_the_wrong_order_give_the_lower_one(run):
    """If min exceeds max the result is min everywhere, as in Caffe."""
    done = run('type: "Clip" clip_param { min: 1 max: -1 }', [-3.0, 0, 3])
    assert done.y.tolist() == [1, 1, 1]
    assert done.backward([5, 5, 5])[0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences within and outside the bounds."""
    x = rng.choice([-2, 0.5, 3], (3, 4)) + rng.uniform(-0.4, 0.4, (3, 4))
    check(CLIP, x, in_place=in_place)
