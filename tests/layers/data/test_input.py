"""Input."""

import pytest

import netlib

pytestmark = pytest.mark.both_engines


def test_one_shape_for_all_tops_or_one_for_each(net_of):
    """Each top has its own shape; forward does not change the data."""
    net = net_of(
        'layer { name: "in" type: "Input" top: "a" top: "b" input_param { shape { dim: 2 } shape { dim: 3 } } }'
    )
    assert [net.blobs[name].shape for name in "ab"] == [(2,), (3,)]
    net.blobs["a"].data[...] = 5
    assert net.forward()["a"].tolist() == [5, 5]


def test_another_number_of_shapes(net_of):
    """A number of shapes that matches neither one nor the tops raises an error."""
    with pytest.raises(netlib.LayerError, match="layer 'in': has 3 tops, but 2 shapes"):
        net_of('layer { name: "in" type: "Input" top: "a" top: "b" top: "c" input_param { shape { } shape { } } }')


def test_a_shape_keeps_what_the_caller_set(net_of):
    """Reshaping the net keeps a shape that the caller has set."""
    net = net_of('layer { name: "in" type: "Input" top: "a" input_param { shape { dim: 2 } } }')
    net.blobs["a"].reshape(7)
    net.reshape()
    assert net.forward()["a"].shape == (7,)


def test_a_negative_size(net_of):
    """A negative size raises an error with its position."""
    with pytest.raises(netlib.NetlibError, match=r"net.prototxt"):
        net_of('layer { name: "in" type: "Input" top: "a" input_param { shape { dim: -2 } } }')
