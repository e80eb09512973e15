"""DummyData, Input and MemoryData."""

import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs

NET = """layer { name: "d" type: "MemoryData" top: "x" top: "t"
                 memory_data_param { batch_size: 2 channels: 3 height: 1 width: 2 } }"""


@pytest.fixture
def data(rng):
    """Six items with labels 0 to 5."""
    return rng.normal(size=(6, 3, 1, 2)).astype(np.float32), np.arange(6, dtype=np.float32)


@pytest.mark.parametrize("shape", [(6,), (6, 1, 1, 1)])
def test_batches_come_in_order_and_go_round(net_of, data, shape):
    """Batches are in order and repeat; labels may have one axis or four, and the top has
    four, as in Caffe.
    """
    net = net_of(NET)
    net.layer_dict["d"].set_input_arrays(data[0], data[1].reshape(shape))
    for first in (0, 2, 4, 0, 2):
        tops = net.forward()
        assert np.array_equal(tops["x"], data[0][first : first + 2])
        assert tops["t"].shape == (2, 1, 1, 1)
        assert tops["t"].ravel().tolist() == [first, first + 1]


def test_new_arrays_and_reset_begin_at_the_first_item(net_of, data):
    """The arrays are not copied and may have any numeric type."""
    net = net_of(NET)
    layer = net.layer_dict["d"]
    layer.set_input_arrays(*data)
    net.forward()
    layer.reset()
    data[1][0] = 40
    assert net.forward()["t"].ravel().tolist() == [40, 1]
    layer.set_input_arrays(np.zeros((2, 3, 1, 2), np.int64), [8, 9])
    for _ in range(2):
        assert net.forward()["t"].ravel().tolist() == [8, 9]


def test_a_resume_goes_on_at_the_same_place(net_of, data):
    net, same, other = net_of(NET), net_of(NET), net_of(NET)
    for made, count in ((net, 6), (same, 6), (other, 4)):
        made.layer_dict["d"].set_input_arrays(data[0][:count], data[1][:count])
    net.forward()
    for made, first in ((same, 2), (other, 0)):
        made.restore_layer_states(netlib.snapshots.snapshot.as_plain(net.layer_states()))
        assert made.forward()["t"].ravel().tolist() == [first, first + 1]


def test_transform_param_is_ignored_with_a_warning(net_of, data, caplog):
    net = net_of(NET[:-1] + "transform_param { scale: 2 } }")
    net.layer_dict["d"].set_input_arrays(*data)
    assert np.array_equal(net.forward()["x"], data[0][:2])
    assert (
        "MemoryData does not transform arrays; transform_param is ignored, as in Caffe"
        in caplog.text
    )


def giving(shape, labels):
    """Rows of data and labels that are given to the layer."""
    labels = np.zeros(labels) if not isinstance(labels, list) else labels
    return lambda net: net.layer_dict["d"].set_input_arrays(np.zeros(shape), labels)


@bad_inputs(
    netlib.LayerError,
    {
        name: (act, f"net.prototxt:1:7: error: layer 'd': {line}")
        for name, act, line in (
            (
                "three items",
                giving((3, 3, 1, 2), 3),
                "found 3 items, expected a multiple of batch_size 2",
            ),
            (
                "no items",
                giving((0, 3, 1, 2), 0),
                "found 0 items, expected a multiple of batch_size 2",
            ),
            ("four labels", giving((2, 3, 1, 2), 4), "found 2 items of data, but 4 labels"),
            (
                "upright",
                giving((2, 3, 2, 1), 2),
                "the data have shape (2, 3, 2, 1), expected (N, 3, 1, 2)",
            ),
            ("two axes", giving((2, 6), 2), "the data have shape (2, 6), expected (N, 3, 1, 2)"),
            (
                "pairs of labels",
                giving((2, 3, 1, 2), (2, 2)),
                "the labels have shape (2, 2), expected (N, 1, 1, 1)",
            ),
            (
                "texts",
                giving((2, 3, 1, 2), ["a", "b"]),
                "the labels must be numbers, found an array of <U1",
            ),
            (
                "none",
                lambda net: net.forward(),
                "has no data; call set_input_arrays(data, labels) before forward",
            ),
        )
    },
)
def test_mistakes_of_memory_data(net_of, given, rejected):
    with rejected:
        given(net_of(NET))


def test_a_size_of_0(net_of):
    with pytest.raises(
        netlib.LayerError, match=r"^net.prototxt:2:64: error: layer 'd': height must be at least 1$"
    ):
        net_of(NET.replace("height: 1", "height: 0"))


def dummy(options, tops=1):
    names = " ".join(f'top: "{"ab"[i]}"' for i in range(tops))
    return f'layer {{ name: "d" type: "DummyData" {names} dummy_data_param {{ {options} }} }}'


@pytest.mark.parametrize(
    ("options", "values"),
    [
        ("shape { dim: 2 dim: 3 } data_filler { value: 1.5 }", [[[1.5] * 3] * 2] * 2),
        ("shape { dim: 2 } data_filler { value: 1 } data_filler { value: 2 }", [[1, 1], [2, 2]]),
        ("shape { dim: 1 } shape { dim: 2 }", [[0], [0, 0]]),
        ("num: 1 channels: 2 height: 1 width: 1", [[[[[0]], [[0]]]]] * 2),
        ("num: 1 num: 2 channels: 1 height: 1 width: 1", [[[[[0]]]], [[[[0]]], [[[0]]]]]),
    ],
)
def test_dummy_shapes_and_values_for_each_top_or_for_all(net_of, options, values):
    """Shapes and fillers apply to one top each or to all; the default is 0, and four sizes may
    replace a shape.
    """
    net = net_of(dummy(options, tops=2))
    net.forward()
    assert [net.blobs[name].data.tolist() for name in "ab"] == values


def test_dummy_random_values_are_new_in_every_batch(net_of):
    net = net_of(
        dummy('shape { dim: 50 } data_filler { type: "gaussian" } data_filler { value: 3 }', tops=2)
    )
    first = net.forward()["a"].copy()
    assert not np.array_equal(net.forward()["a"], first)
    assert (net.blobs["b"].data == 3).all()


@bad_inputs(
    netlib.LayerError,
    {
        "": "net.prototxt:1:7: error: layer 'd': has 3 tops, but 0 of shape",
        "shape { } shape { }": "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of shape",
        "shape { } data_filler { } data_filler { }": (
            "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of data_filler"
        ),
        "num: 1 num: 2 channels: 1 height: 1 width: 1": (
            "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of num"
        ),
        "num: 1 channels: 1 width: 1": "net.prototxt:1:7: error: layer 'd': has 3 tops, but 0 of height",
        "shape { } num: 1 channels: 1 height: 1 width: 1": (
            "net.prototxt:1:...: error: layer 'd': has both shape and the older num, channels, "
            "height, width; expected one"
        ),
    },
)
def test_mistakes_of_dummy_data(net_of, given, rejected):
    with rejected:
        net_of(
            f'layer {{ name: "d" type: "DummyData" top: "a" top: "b" top: "c" dummy_data_param {{ {given} }} }}'
        )


def test_input_has_one_shape_for_all_tops_or_one_for_each(net_of):
    net = net_of(
        'layer { name: "in" type: "Input" top: "a" top: "b" input_param { shape { dim: 2 } shape { dim: 3 } } }'
    )
    assert [net.blobs[name].shape for name in "ab"] == [(2,), (3,)]
    net.blobs["a"].data[...] = 5
    assert net.forward()["a"].tolist() == [5, 5]


@bad_inputs(
    netlib.LayerError,
    {
        "two shapes": (
            'top: "a" top: "b" top: "c" input_param { shape { } shape { } }',
            "net.prototxt:1:75: error: layer 'in': has 3 tops, but 2 shapes",
        ),
        "negative": (
            'top: "a" input_param { shape { dim: -2 } }',
            "net.prototxt:1:57: error: layer 'in': shape (-2,) has a negative size",
        ),
    },
)
def test_mistakes_of_input(net_of, given, rejected):
    with rejected:
        net_of(f'layer {{ name: "in" type: "Input" {given} }}')


def test_input_keeps_what_the_caller_set(net_of):
    net = net_of('layer { name: "in" type: "Input" top: "a" input_param { shape { dim: 2 } } }')
    net.blobs["a"].reshape(7)
    net.reshape()
    assert net.forward()["a"].shape == (7,)
