"""Normalize."""

import numpy as np
import pytest

NET = """
input: "x" input_shape { dim: 2 dim: 3 }
layer { name: "n" type: "Normalize" bottom: "x" top: "y" norm_param { channel_shared: false } }
"""


def text(across="true", shared="true", more=""):
    return f'type: "Normalize" norm_param {{ across_spatial: {across} channel_shared: {shared} {more} }}'


def test_by_hand_at_each_position(run):
    """The channels (3, 4) have length 5, (0, 2) length 2; the scales are 10 and 100."""
    x = np.array([[3.0, 0], [4, 2]]).reshape(1, 2, 1, 2)
    done = run(text("false", "false"), x, params=[[10, 100]])
    assert np.allclose(done.y.reshape(2, 2), [[6, 0], [80, 100]])


def test_by_hand_over_the_item(run):
    """The item (1, 2, 4, 10) has length 11; the default scale is 1."""
    x = np.array([1.0, 2, 4, 10]).reshape(1, 2, 1, 2)
    done = run('type: "Normalize"', x)
    assert np.allclose(done.y, x / 11)
    assert done.layer.scale.shape == ()


def test_gradient_by_hand(run):
    """Of dy = (1, 1) only the part across x = (3, 4) remains: (1, 1) - (3, 4) 7 / 25, divided by 5."""
    done = run(text(), [[3.0, 4]])
    assert np.allclose(done.backward([[1, 1]])[0], [[0.032, -0.024]])
    assert np.isclose(done.layer.scale.diff, 7 / 5)


def test_eps_is_added_to_the_sum_of_squares(run):
    """With eps 16, the channels (3, 0) have length 5; zeros stay zeros."""
    assert np.allclose(run(text("false", more="eps: 16"), [[3.0, 0]]).y, [[0.6, 0]])
    assert run(text(), np.zeros((2, 3))).y.tolist() == np.zeros((2, 3)).tolist()


@pytest.mark.parametrize("shape", [(3,), (1, 3), (1, 1, 3), (1, 1, 1, 3)], ids=str)
def test_weights_with_leading_ones(net_of, tmp_path, shape):
    """Scales of other programs, with leading axes of size 1, are loaded from both formats."""
    net, other = net_of(NET), net_of(NET)
    net.params["n"][0].data[...] = 1, 2, 3
    net.params["n"][0].reshape(shape)
    for name in ("n.caffemodel", "n.caffemodel.h5"):
        net.save(tmp_path / name)
        other.params["n"][0].data[...] = 0
        other.copy_from(tmp_path / name)
        assert other.params["n"][0].data.tolist() == [1, 2, 3]


def test_a_shared_scale_with_leading_ones(net_of, tmp_path):
    """A shared scale has no axes; a file may have (1, 1, 1, 1)."""
    text = 'input: "x" input_shape { dim: 2 dim: 3 } layer { name: "n" type: "Normalize" bottom: "x" top: "y" }'
    net, other = net_of(text), net_of(text)
    net.params["n"][0].data[...] = 7
    for shape in [(), (1,), (1, 1, 1, 1)]:
        net.params["n"][0].reshape(shape)
        net.save(tmp_path / "n.caffemodel")
        other.params["n"][0].data[...] = 0
        other.copy_from(tmp_path / "n.caffemodel")
        assert other.params["n"][0].data == 7
