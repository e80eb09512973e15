"""Filter."""

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("selector", "passed"), [([[1], [1], [1]], 3), ([[[0]], [[0]], [[2]]], 1), ([0, 0, 0], 0)]
)
def test_all_some_or_no_items_pass(run, rng, selector, passed):
    """The selector may have further axes of size 1; if no item passes, the gradient is 0."""
    done = run('type: "Filter"', rng.normal(size=(3, 2, 2)), selector)
    assert done.y.shape == (passed, 2, 2)
    dx = done.backward(np.ones((passed, 2, 2)), wanted=[True, False])[0]
    assert np.count_nonzero(dx) == 4 * passed


def test_in_a_net_the_number_of_items_follows_the_selector(net_of, rng):
    net = net_of(
        'force_backward: true layer { name: "in" type: "Input" top: "x" top: "s" '
        "input_param { shape { dim: 4 dim: 3 } shape { dim: 4 } } } "
        'layer { name: "f" type: "Filter" bottom: "x" bottom: "s" top: "y" } '
        'layer { name: "relu" type: "ReLU" bottom: "y" top: "r" } '
        'layer { name: "fc" type: "InnerProduct" bottom: "r" top: "z" '
        'inner_product_param { num_output: 2 weight_filler { type: "gaussian" } } }'
    )
    assert net.blobs["z"].shape == (4, 2)
    x = rng.normal(size=(4, 3)).astype(np.float32)
    for selector in ([1, 0, 1, 1], [0, 0, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]):
        passed = np.flatnonzero(selector)
        z = net.forward(x=x, s=np.array(selector))["z"]
        assert np.allclose(z, np.maximum(x[passed], 0) @ net.params["fc"][0].data.T, atol=1e-6)
        dx = net.backward(z=np.ones((len(passed), 2)))["x"]
        want = np.zeros((4, 3))
        want[passed] = (x[passed] > 0) * net.params["fc"][0].data.sum(axis=0)
        assert np.allclose(dx, want, atol=1e-6)
