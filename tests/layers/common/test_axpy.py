"""Axpy."""

import numpy as np
import pytest

TEXT = 'type: "Axpy"'


@pytest.mark.parametrize("shape", [(1, 2), (1, 2, 1, 1)], ids=str)
def test_by_hand(run, shape):
    """Channel 0 is scaled by 2 and channel 1 by 10."""
    x, y = [[[[1, 2]], [[3, 4]]]], [[[[5, 5]], [[6, 6]]]]
    done = run(TEXT, np.array([2, 10]).reshape(shape), x, y)
    assert done.y.tolist() == [[[[7, 9]], [[36, 46]]]]
    da, dx, dy = done.backward([[[[1, 1]], [[0, 1]]]])
    assert da.tolist() == np.array([3, 4]).reshape(shape).tolist()
    assert dx.tolist() == [[[[2, 2]], [[0, 10]]]]
    assert dy.tolist() == [[[[1, 1]], [[0, 1]]]]
