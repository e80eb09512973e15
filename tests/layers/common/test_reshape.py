"""Reshape."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        ("shape { dim: 6 dim: 4 }", (6, 4)),
        ("shape { dim: 0 dim: -1 }", (2, 12)),
        ("shape { dim: 0 dim: 0 dim: 2 dim: 2 }", (2, 3, 2, 2)),
        ("shape { dim: -1 }", (24,)),
        ("shape { dim: 12 } axis: 1", (2, 12)),
        ("shape { dim: 3 dim: 1 } axis: 1 num_axes: 1", (2, 3, 1, 4)),
        ("shape { dim: 2 dim: 2 } axis: -2", (2, 3, 2, 2)),
        ("shape { dim: 1 dim: 1 } axis: -1", (2, 3, 4, 1, 1)),
        ("shape { dim: 1 } axis: 0 num_axes: 0", (1, 2, 3, 4)),
        ("shape { } axis: 1 num_axes: 0", (2, 3, 4)),
    ],
)
def test_shapes(run, rng, options, shape):
    """0 copies a size, -1 is inferred, and axis and num_axes select the replaced axes."""
    x = rng.normal(size=(2, 3, 4))
    done = run(f'type: "Reshape" reshape_param {{ {options} }}', x)
    assert np.array_equal(done.y, x.reshape(shape))
    dy = rng.normal(size=shape)
    assert np.array_equal(done.backward(dy)[0], dy.reshape(x.shape))
