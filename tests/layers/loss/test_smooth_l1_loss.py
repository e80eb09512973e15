"""SmoothL1Loss."""

import numpy as np
import pytest


def text(sigma=2.0):
    return f'type: "SmoothL1Loss" smooth_l1_loss_param {{ sigma: {sigma} }}'


def test_by_hand(run):
    """The loss is 4 d² / 2 for 0.125 and abs(d) - 1/8 for 1 and -3, over two items."""
    done = run(text(), [[0.125, 1], [0, 0]], [[0, 0], [3, 0]])
    assert done.y == pytest.approx((0.03125 + 0.875 + 2.875) / 2)
    da, db = done.backward(3)
    assert da.tolist() == [[0.75, 1.5], [-1.5, 0]]
    assert db.tolist() == (-da).tolist()


def test_inside_weights_scale_the_difference_and_outside_ones_the_loss(run):
    done = run(text(), [[1.0, 1.0]], [[0.0, 0.0]], [[0.125, 2.0]], [[1.0, 10.0]])
    assert done.y == pytest.approx(0.03125 + 10 * 1.875)


def test_inside_weights_alone(run):
    """The third bottom of Fast R-CNN, where the loss has no outside weights, selects values."""
    done = run(text(), [[1.0, 1.0]], [[0.0, 0.0]], [[0.125, 0.0]])
    assert done.y == pytest.approx(0.03125)
    assert done.backward(1, wanted=[True, True, False])[0].tolist() == [[0.0625, 0]]


def test_a_reshape_to_the_same_shape_keeps_the_gradient(net_of, rng):
    a = 'layer { name: "a" type: "Input" top: "a" top: "b" input_param { shape { dim: 4 dim: 3 } } } '
    net = net_of(
        "force_backward: true " + a + 'layer { name: "l" type: "SmoothL1Loss" bottom: "a" bottom: "b" top: "l" }'
    )
    net.forward(a=rng.normal(size=(4, 3)), b=rng.normal(size=(4, 3)))
    expected = net.backward()["a"].copy()
    net.reshape()
    assert np.array_equal(net.backward()["a"], expected)
