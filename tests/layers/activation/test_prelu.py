"""PReLU."""

import numpy as np
import pytest

SHARED = 'type: "PReLU" prelu_param { channel_shared: true }'


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """Each channel has one slope; at 0 the gradient is that of the negative side."""
    done = run('type: "PReLU"', [[-2, -2, 3], [0, 1, -1]], params=[[0.5, -1, 2]], in_place=in_place)
    assert done.y.tolist() == [[-1, 2, 3], [0, 1, -2]]
    assert done.backward([[1, 1, 1], [1, 1, 1]])[0].tolist() == [[0.5, -1, 1], [0.5, 1, 2]]
    assert done.layer.blobs[0].diff.tolist() == [-2, -2, -1]


def test_one_slope_for_all(run):
    """With channel_shared the slope is a single number for all channels."""
    done = run(SHARED, [[-2, -2, 3], [0, 1, -1]], params=[0.5])
    assert done.layer.blobs[0].shape == ()
    assert done.y.tolist() == [[-1, -1, 3], [0, 1, -0.5]]
    done.backward([[1, 2, 3], [4, 5, 6]])
    assert done.layer.blobs[0].diff == -2 - 4 - 6


def test_initial_slopes(run):
    """The initial slope is 0.25; a filler without a value gives 0, as in Caffe."""
    x = np.ones((2, 3))
    assert run('type: "PReLU"', x).layer.blobs[0].data.tolist() == [0.25] * 3
    assert run(SHARED, x).layer.blobs[0].data == 0.25
    filled = run('type: "PReLU" prelu_param { filler { type: "constant" } }', x)
    assert filled.layer.blobs[0].data.tolist() == [0] * 3
