"""Input."""


import netlib
from tests.support.bad_input import bad_inputs


def test_one_shape_for_all_tops_or_one_for_each(net_of):
    net = net_of(
        'layer { name: "in" type: "Input" top: "a" top: "b" input_param { shape { dim: 2 } shape { dim: 3 } } }'
    )
    assert [net.blobs[name].shape for name in "ab"] == [(2,), (3,)]
    net.blobs["a"].data[...] = 5
    assert net.forward()["a"].tolist() == [5, 5]


@bad_inputs(netlib.LayerError, {
    "two shapes": ('top: "a" top: "b" top: "c" input_param { shape { } shape { } }',
                   "net.prototxt:1:75: error: layer 'in': has 3 tops, but 2 shapes"),
    "negative": ('top: "a" input_param { shape { dim: -2 } }',
                 "net.prototxt:1:57: error: layer 'in': shape (-2,) has a negative size"),
})
def test_mistakes(net_of, given, rejected):
    with rejected:
        net_of(f'layer {{ name: "in" type: "Input" {given} }}')


def test_a_shape_keeps_what_the_caller_set(net_of):
    net = net_of('layer { name: "in" type: "Input" top: "a" input_param { shape { dim: 2 } } }')
    net.blobs["a"].reshape(7)
    net.reshape()
    assert net.forward()["a"].shape == (7,)
