"""Parameter."""

import numpy as np

NET = """
layer { name: "w" type: "Parameter" top: "w" parameter_param { shape { dim: 2 dim: 3 } } param { lr_mult: 2 } }
layer { name: "sum" type: "Reduction" bottom: "w" top: "loss" loss_weight: 1 reduction_param { operation: SUMSQ } }
"""


def test_the_top_is_the_parameter(net_of):
    net = net_of(NET)
    assert net.forward()["loss"] == 0
    net.params["w"][0].data[...] = [[1, 2, 3], [4, 5, 6]]
    assert net.forward()["loss"] == 91
    net.clear_param_diffs()
    net.backward()
    assert net.params["w"][0].diff.tolist() == [[2, 4, 6], [8, 10, 12]]
    net.backward()
    assert net.params["w"][0].diff.tolist() == [[4, 8, 12], [16, 20, 24]], (
        "added, as for every parameter"
    )


def test_in_place_behind_it_leaves_the_parameter_alone(net_of):
    net = net_of(
        NET.replace(
            'layer { name: "sum"',
            'layer { name: "r" type: "ReLU" bottom: "w" top: "w" }\nlayer { name: "sum"',
        )
    )
    net.params["w"][0].data[...] = -1
    assert net.forward()["loss"] == 0
    assert (net.params["w"][0].data == -1).all()


def test_without_a_shape_it_is_one_number(net_of):
    assert net_of('layer { name: "w" type: "Parameter" top: "w" }').params["w"][0].shape == ()


def test_shared_by_name(net_of):
    net = net_of(
        NET.replace("lr_mult: 2", 'name: "one"')
        + 'layer { name: "v" type: "Parameter" top: "v" parameter_param { shape { dim: 2 dim: 3 } } '
        'param { name: "one" } }'
    )
    net.params["w"][0].data[...] = 5
    assert (net.forward()["v"] == 5).all()
    assert len(net.learnable) == 1
    assert np.shares_memory(net.params["v"][0].data, net.params["w"][0].data)
