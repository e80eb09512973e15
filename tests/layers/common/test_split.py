"""Split."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


def test_copies_and_sums(run, rng):
    """Every top is a copy of the bottom; the bottom's gradient is the sum of the tops' gradients."""
    x, dy = rng.normal(size=(2, 3)), rng.normal(size=(3, 2, 3))
    done = run('type: "Split"', x, tops=3)
    assert all(np.array_equal(y, x) for y in done.ys)
    assert np.allclose(done.backward(*dy)[0], dy.sum(axis=0))
