"""Parameters with the same name are shared."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt, schema
from netlib.proto.messages import NetParameter, ParamSpec
from tests.netlib.conftest import MakeNet
from tests.support.nets import X, ip, loss, shared

pytestmark = pytest.mark.both_engines


def test_shared_parameters_are_one(net_of: MakeNet, rng: np.random.Generator) -> None:
    """Shared parameters have one blob and one learnable entry, with the sum of both
    layers' gradients.
    """
    net = net_of(shared() + loss("b"), dtype=np.float64)
    [of_a, _], [of_b, _] = net.params["a"], net.params["b"]
    assert np.shares_memory(of_a.data, of_b.data)
    assert np.shares_memory(of_a.diff, of_b.diff)
    assert [p.label for p in net.learnable] == ["a/0", "a/1", "b/1"]
    x = rng.normal(size=(2, 3))
    net.forward(x=x)
    net.backward()
    da, db = net.blobs["a"].diff, net.blobs["b"].diff
    both = da.T @ x + db.T @ net.blobs["a"].data
    assert np.allclose(of_a.diff, both)
    of_b.diff[...] = np.nan
    net.clear_param_diffs()
    net.backward()
    assert np.allclose(of_a.diff, both)


def test_permissive_sharing_requires_only_equal_counts(net_of: MakeNet) -> None:
    """(2, 6) and (3, 4) weights use the same memory."""
    shapes = "shape { dim: 2 dim: 6 } shape { dim: 2 dim: 4 }"
    text = f'layer {{ name: "x" type: "Input" top: "x" top: "y" input_param {{ {shapes} }} }} '
    text += ip("a", "x", "a", 'param { name: "w" }', 2) + ip(
        "b", "y", "b", 'param { name: "w" share_mode: PERMISSIVE }', 3
    )
    net = net_of("force_backward: true " + text)
    [of_a, *_], [of_b, *_] = net.params["a"], net.params["b"]
    assert (of_a.data.shape, of_b.data.shape) == ((2, 6), (3, 4))
    of_a.data[0, 5] = 9
    assert of_b.data[1, 1] == 9
    net.forward(x=np.ones((2, 6)), y=np.ones((2, 4)))
    net.backward(a=np.ones((2, 2)), b=np.zeros((2, 3)))
    assert (of_b.diff == 2).all()


def test_multipliers_of_a_shared_parameter_may_stand_in_either_layer(net_of: MakeNet) -> None:
    text = (
        X
        + ip("a", "x", "a", 'param { name: "w" lr_mult: 2 }')
        + ip("b", "a", "b", 'param { name: "w" decay_mult: 0 }')
    )
    owner = net_of(text).learnable[0].spec
    assert (owner.lr_mult, owner.decay_mult) == (2, 0)


def test_a_program_may_set_a_multiplier_of_a_shared_parameter() -> None:
    param = schema.read(prototxt.parse(shared()), NetParameter)
    *others, last = param.layer
    last = schema.changed(last, param=(ParamSpec("w", lr_mult=0.0),))
    with pytest.raises(netlib.LayerError, match="has lr_mult 0, but 2 in layer 'a'"):
        netlib.Net(schema.changed(param, layer=(*others, last)), netlib.TRAIN)


def test_param_blocks_count_from_the_first(net_of: MakeNet) -> None:
    """With one param block the bias has lr_mult 1 and decay_mult 1."""
    net = net_of(X + ip("a", "x", "a", "param { lr_mult: 5 decay_mult: 0 }"))
    assert [(p.spec.lr_mult, p.spec.decay_mult) for p in net.learnable] == [(5, 0), (1, 1)]


def test_a_layer_reads_a_reshaped_parameter_in_its_own_shape(net_of: MakeNet) -> None:
    """As in Caffe; the caller's shape stays, also in files."""
    net, other = net_of(shared() + loss("b")), net_of(shared() + loss("b"))
    other.copy_from(net)
    for name in ("a", "b"):
        for blob in net.params[name]:
            blob.reshape(1, *reversed(blob.shape))
    for one in (net, other):
        one.forward(x=np.arange(6).reshape(2, 3))
        one.backward()
    for mine, theirs in zip(net.learnable, other.learnable):
        assert mine.blob.shape == (1, *reversed(theirs.blob.shape))
        assert np.array_equal(mine.blob.diff.ravel(), theirs.blob.diff.ravel())
    assert np.array_equal(net.blobs["b"].data, other.blobs["b"].data)


@pytest.mark.parametrize("shape", [(6, 3), (1, 3)])
def test_a_parameter_with_another_number_of_values_is_an_error(
    net_of: MakeNet, shape: tuple[int, ...]
) -> None:
    net = net_of(X + ip("a", "x", "a"))
    before = net.forward()["a"].copy()
    values = net.params["a"][0].data.copy()
    net.params["a"][0].reshape(shape)
    with pytest.raises(
        netlib.LayerError,
        match=r"'a': parameter 0 was reshaped to \(., 3\), but the layer computes with \(3, 3\)",
    ):
        net.forward()
    net.params["a"][0].reshape(3, 3)
    net.params["a"][0].data[...] = values
    assert np.array_equal(net.forward()["a"], before)
