"""Layers of one value to one value, in new tops and in place."""

import numpy as np
import pytest


@pytest.mark.parametrize(("kind", "most"), [("ReLU", np.inf), ("ReLU6", 6)])
@pytest.mark.parametrize(
    "shape", [(), (1,), (0, 20_000), (3, 5), (2, 1 << 14), (3, (1 << 14) + 5), (5, 7, 1000)]
)
def test_any_size_and_order(run, rng, kind, most, shape):
    """Long rows, odd sizes and scalars give the same values, although they are computed in
    different ways.
    """
    x, dy = rng.normal(3, 5, size=shape), rng.normal(size=shape)
    done = run(f'type: "{kind}"', x)
    assert np.array_equal(done.y, np.clip(x, 0, most))
    assert np.array_equal(done.backward(dy)[0], dy * (x > 0) * (x < most))
