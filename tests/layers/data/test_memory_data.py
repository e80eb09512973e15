"""MemoryData."""

import numpy as np
import pytest

import netlib

pytestmark = pytest.mark.both_engines

NET = """layer { name: "d" type: "MemoryData" top: "x" top: "t"
                 memory_data_param { batch_size: 2 channels: 3 height: 1 width: 2 } }"""


@pytest.fixture
def data(rng):
    """Six items with labels 0 to 5."""
    return rng.normal(size=(6, 3, 1, 2)).astype(np.float32), np.arange(6, dtype=np.float32)


@pytest.mark.parametrize("shape", [(6,), (6, 1, 1, 1)])
def test_batches_come_in_order_and_go_round(net_of, data, shape):
    """Batches are in order and repeat; labels may have one axis or four, and the top has four, as in Caffe."""
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
    """With the same arrays a resumed net continues; with others it starts at the first item."""
    net, same, other = net_of(NET), net_of(NET), net_of(NET)
    for made, count in ((net, 6), (same, 6), (other, 4)):
        made.layer_dict["d"].set_input_arrays(data[0][:count], data[1][:count])
    net.forward()
    for made, first in ((same, 2), (other, 0)):
        made.restore_layer_states(netlib.snapshots.snapshot.as_plain(net.layer_states()))
        assert made.forward()["t"].ravel().tolist() == [first, first + 1]


def test_transform_param_is_ignored_with_a_warning(net_of, data, caplog):
    """transform_param is ignored, as in Caffe, with a warning that a script sees."""
    net = net_of(NET[:-1] + "transform_param { scale: 2 } }")
    net.layer_dict["d"].set_input_arrays(*data)
    assert np.array_equal(net.forward()["x"], data[0][:2])
    assert "MemoryData does not transform arrays; transform_param is ignored, as in Caffe" in caplog.text


@pytest.mark.parametrize(
    ("shape", "labels", "message"),
    [
        ((3, 3, 1, 2), 3, "found 3 items, expected a multiple of batch_size 2"),
        ((0, 3, 1, 2), 0, "found 0 items, expected a multiple of batch_size 2"),
        ((2, 3, 1, 2), 4, "found 2 items of data, but 4 labels"),
        ((2, 3, 2, 1), 2, r"the data have shape \(2, 3, 2, 1\), expected \(N, 3, 1, 2\)"),
        ((2, 6), 2, r"the data have shape \(2, 6\), expected \(N, 3, 1, 2\)"),
        ((2, 3, 1, 2), (2, 2), r"the labels have shape \(2, 2\), expected \(N, 1, 1, 1\)"),
    ],
)
def test_arrays_that_do_not_fit(net_of, shape, labels, message):
    """The error states the given and the expected shape or number."""
    with pytest.raises(netlib.LayerError, match=f"layer 'd': {message}"):
        net_of(NET).layer_dict["d"].set_input_arrays(np.zeros(shape), np.zeros(labels))


def test_mistakes(net_of):
    """Missing data, labels that are not numbers and a size of 0 raise an error."""
    with pytest.raises(netlib.LayerError, match="layer 'd': has no data; call set_input_arrays"):
        net_of(NET).forward()
    with pytest.raises(netlib.LayerError, match="layer 'd': the labels must be numbers, found an array of <U1"):
        net_of(NET).layer_dict["d"].set_input_arrays(np.zeros((2, 3, 1, 2)), ["a", "b"])
    with pytest.raises(netlib.LayerError, match=r"net.prototxt:2:\d+: error: layer 'd': height must be at least 1"):
        net_of(NET.replace("height: 1", "height: 0"))
