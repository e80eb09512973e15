"""Im2col: patches as columns."""

import numpy as np
import pytest


def text(options):
    return f'type: "Im2col" convolution_param {{ {options} }}'


def test_by_hand(run):
    """Row (i, j) holds the pixels multiplied by kernel element (i, j); the gradient sums all columns of a pixel."""
    done = run(text("kernel_size: 2"), np.arange(6.0).reshape(1, 1, 2, 3))
    assert done.y[0].tolist() == [[[0, 1]], [[1, 2]], [[3, 4]], [[4, 5]]]
    [dx] = done.backward(np.ones((1, 4, 1, 2)))
    assert dx[0, 0].tolist() == [[1, 2, 1], [1, 2, 1]]


@pytest.mark.parametrize("shape", [(2, 3, 7), (2, 3, 5, 6), (1, 2, 4, 3, 5)], ids=str)
def test_a_product_with_the_kernel_is_a_convolution(run, rng, shape):
    """The product with the kernel equals a Convolution for any number of axes; options of the weights are ignored."""
    windows = "num_output: 4 bias_term: false kernel_size: 2 stride: 2 pad: 1 dilation: 2"
    x, w = rng.normal(size=shape), rng.normal(size=(4, shape[1], *[2] * (len(shape) - 2)))
    columns = run(text(windows), x).y
    y = run(f'type: "Convolution" convolution_param {{ {windows} }}', x, params=[w]).y
    assert np.allclose(np.einsum("ok,nk...->no...", w.reshape(4, -1), columns), y)
