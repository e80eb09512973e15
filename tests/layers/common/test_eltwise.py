"""Eltwise."""

import numpy as np
import pytest

A, B, C = [1.0, 2, -3], [4.0, 2, 0], [0.5, 2, 5]


def text(options=""):
    return f'type: "Eltwise" eltwise_param {{ {options} }}'


@pytest.mark.parametrize(("options", "y", "grads"), [
    ("", [5.5, 6, 2], [[1, 1, 1]] * 3),
    ("coeff: 1 coeff: -2 coeff: 0.5", [-6.75, -1, -0.5], [[1] * 3, [-2] * 3, [0.5] * 3]),
    ("operation: PROD", [2, 8, 0], [[2, 4, 0], [0.5, 4, -15], [4, 4, 0]]),
    ("operation: MAX", [4, 2, 5], [[0, 0, 0], [1, 1, 0], [0, 0, 1]]),  # of equal values the second one is taken
])
def test_by_hand(run, options, y, grads):
    """The values and the gradients of each bottom for dy = 1 agree."""
    done = run(text(options), A, B, C)
    assert done.y.tolist() == y
    assert [dx.tolist() for dx in done.backward([1, 1, 1])] == grads


def test_an_unstable_product_of_0_has_no_gradient(run):
    """At 0 the unstable gradient of a product is NaN without a warning, as in Caffe."""
    unstable = run(text("operation: PROD stable_prod_grad: false"), A, B).backward([1, 1, 1])
    assert np.isnan(unstable[1]).tolist() == [False, False, True]


def test_a_maximum_ignores_coefficients(run):
    """MAX ignores coeff, as in Caffe."""
    assert run(text("operation: MAX coeff: -1 coeff: 5"), A, B).y.tolist() == [4, 2, 0]
