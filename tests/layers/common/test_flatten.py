"""Flatten."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "shape"),
    [("", (2, 60)), ("axis: 0", (120,)), ("axis: 2", (2, 3, 20)), ("axis: 1 end_axis: 2", (2, 12, 5)),
     ("axis: -2", (2, 3, 20)), ("axis: 1 end_axis: -2", (2, 12, 5)), ("axis: 1 end_axis: 1", (2, 3, 4, 5)),
     ("axis: 2 end_axis: 1", (2, 3, 1, 4, 5))],
)
def test_axes_are_joined(run, rng, options, shape):
    """The values keep their order, and the gradient has the shape of the bottom."""
    x = rng.normal(size=(2, 3, 4, 5))
    done = run(f'type: "Flatten" flatten_param {{ {options} }}', x)
    assert np.array_equal(done.y, x.reshape(shape))
    dy = rng.normal(size=shape)
    assert np.array_equal(done.backward(dy)[0], dy.reshape(x.shape))
