"""Net: construction, forward and backward passes, and weights."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from netlib.proto.messages import SolverParameter
from tests.netlib.conftest import MakeNet
from tests.support.nets import ONE, TWO, X, inputs, ip, loss

pytestmark = pytest.mark.both_engines


def test_the_constructor_is_pycaffes(net_of: MakeNet, here: Path) -> None:
    Path("net.prototxt").write_text(X + ip("ip", "x", "y"))
    first = netlib.Net("net.prototxt", netlib.TRAIN, seed=3)
    first.save("w.h5")
    for net in (
        netlib.Net("net.prototxt", "w.h5", netlib.TEST),
        netlib.Net("net.prototxt", phase=netlib.TEST, weights="w.h5"),
    ):
        assert net.phase == netlib.TEST
        assert np.array_equal(net.params["ip"][0].data, first.params["ip"][0].data)


def test_set_random_seed_decides_the_weights(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The seed applies to nets and solvers without their own seed; each one gets different
    numbers, as in Caffe.
    """
    monkeypatch.setattr(netlib.net, "_seeds", None)
    tree = prototxt.parse(X + ip("ip", "x", "y"))
    options = SolverParameter(net_param=tree, base_lr=0.1, lr_policy="fixed")
    found = []
    for seed in (1, 1, 2):
        netlib.set_random_seed(seed)
        nets = [
            netlib.Net(tree, netlib.TRAIN),
            netlib.Net(tree, netlib.TRAIN),
            netlib.Solver(options).net,
        ]
        found.append([net.params["ip"][0].data.tolist() for net in nets])
    assert found[0] == found[1]
    assert all(one != two for one, two in zip(found[1], found[2]))
    assert found[0][0] != found[0][1] != found[0][2]


def test_forward_takes_inputs_and_gives_outputs(net_of: MakeNet, rng: np.random.Generator) -> None:
    """Inputs and outputs are passed by name, with more blobs on request; outputs are blobs that
    no layer reads.
    """
    net = net_of(TWO)
    x = rng.normal(size=(2, 3)).astype(np.float32)
    found = net.forward(["a"], x=x)
    assert sorted(found) == ["a", "b"]
    assert net.outputs == ["b"]
    w, b = (p.data for p in net.params["a"])
    assert np.allclose(found["a"], x @ w.T + b)


def test_a_new_batch_size_reshapes_the_net(net_of: MakeNet) -> None:
    """Both inputs, which must agree, get their new shape before the net is reshaped."""
    net = net_of(X + loss("x"))
    found = net.forward(x=np.ones((5, 3)), t=np.zeros((5, 3)))
    assert float(found["loss"]) == pytest.approx(1.5)


def test_forward_from_one_layer_to_another(net_of: MakeNet) -> None:
    net = net_of(TWO + ip("c", "b", "c"))
    x = np.ones((2, 3))
    whole = {name: net.forward(["a", "b"], x=x)[name].copy() for name in "abc"}
    net.blobs["a"].data[...] = 0
    found = net.forward(start="b", end="b")
    assert list(found) == ["b"]
    assert np.allclose(found["b"], net.params["b"][1].data)
    assert np.array_equal(net.blobs["c"].data, whole["c"])
    assert np.allclose(net.forward(end="a")["a"], whole["a"])
    assert np.allclose(net.forward(start="b")["c"], whole["c"])


@pytest.mark.parametrize("written", ["a", "a_a_0_split_0", "a_a_0_split_1"])
def test_all_readers_of_a_blob_see_what_a_caller_writes(net_of: MakeNet, written: str) -> None:
    readers = "".join(
        f'layer {{ name: "{top}" type: "AbsVal" bottom: "a" top: "{top}" }} ' for top in "bc"
    )
    net = net_of(inputs(x=(4, 3)) + ip("a", "x", "a") + readers)
    for value in (5, 7):  # also if a part has run before
        net.forward(x=np.ones((4, 3)))
        net.blobs[written].data[...] = value
        found = net.forward(start="b")
        assert (found["b"] == value).all()
        assert (found["c"] == value).all()


def test_a_part_after_a_reshape_of_a_blob_alone_is_an_error(net_of: MakeNet) -> None:
    python = 'python_param { module: "tests.support.random_layers" layer: "Gain" }'
    net = net_of(
        X
        + ip("a", "x", "a")
        + f'layer {{ name: "b" type: "Python" bottom: "x" top: "b" {python} }}'
    )
    net.blobs["x"].reshape(4, 3)
    with pytest.raises(netlib.NetlibError, match=r"reshaped to \(4, 3\): call net.reshape\(\)"):
        net.forward(start="b")


def test_backward_from_one_layer_to_another(net_of: MakeNet) -> None:
    net = net_of("force_backward: true " + TWO)
    net.forward(x=np.ones((2, 3)))
    found = net.backward(["a"], end="b", b=np.ones((2, 3)))
    assert np.allclose(found["a"], np.ones((2, 3)) @ net.params["b"][0].data)
    assert list(found) == ["a"]  # the bottoms of the last layer
    assert not net.blobs["x"].diff.any()
    net.backward(start="a")
    assert np.allclose(net.blobs["x"].diff, net.blobs["a"].diff @ net.params["a"][0].data)
    net.blobs["x"].reshape(5, 3)
    net.blobs["x"].data[...] = 1
    net.forward(end="a")
    net.blobs["a"].diff[:] = net.blobs["a"].data  # as DeepDream does
    net.backward(start="a")
    assert np.allclose(net.blobs["x"].diff, net.blobs["a"].data @ net.params["a"][0].data)


def test_param_diffs_add_up_until_they_are_cleared(net_of: MakeNet) -> None:
    net = net_of(ONE + loss("a"))
    diff = net.params["a"][0].diff  # stays the parameter's own, for a layer that keeps it
    net.forward(x=np.ones((2, 3)))
    net.backward()
    once = diff.copy()
    net.backward()
    assert np.allclose(diff, 2 * once)
    net.clear_param_diffs()
    assert once.any()
    assert not diff.any()
    diff[...] = np.nan
    net.clear_param_diffs()
    net.backward()
    assert np.allclose(diff, once)


def test_copy_from_copies_by_layer_name(net_of: MakeNet, here: Path) -> None:
    """Weights are copied from a file or a net; layers that exist only in the
    source are returned.
    """
    source = net_of(ONE + ip("more", "a", "more"))
    net = net_of(X + ip("a", "x", "y"), seed=2)
    source.save("w.h5")
    for origin in (source, Path("w.h5")):
        net.params["a"][0].data[...] = 0
        assert net.copy_from(origin) == (["more"], [])
        assert np.array_equal(net.params["a"][0].data, source.params["a"][0].data)


NO_BIAS = TWO.replace("num_output: 3", "num_output: 3 bias_term: false")


@pytest.mark.parametrize(
    ("saved", "text", "message"),
    [
        (
            TWO,
            ONE + ip("b", "a", "b", outputs=4),
            r"layer 'b' parameter 0 has shape \(3, 3\), the net expects \(4, 3\); .* another name",
        ),
        (
            TWO,
            X + ip("other", "x", "y"),
            "it has no layer of net ''; it has a, b.*, the net has other",
        ),
        (TWO, NO_BIAS, "layer 'a' has 2 parameters, the net expects 1"),
        (NO_BIAS, TWO, "layer 'a' lacks parameter 1, the net has 2"),
    ],
)
def test_weights_that_do_not_fit_change_nothing(
    net_of: MakeNet, here: Path, saved: str, text: str, message: str
) -> None:
    net_of(saved).save("w.h5")
    net = net_of(text, seed=2)
    before = [p.blob.data.copy() for p in net.learnable]
    with pytest.raises(netlib.WeightsError, match=message):
        net.copy_from("w.h5")
    assert all(np.array_equal(p.blob.data, old) for p, old in zip(net.learnable, before))


@pytest.mark.parametrize(
    "layer",
    [
        ip("a", "x", "a"),
        'layer { name: "a" type: "PReLU" bottom: "x" top: "a" prelu_param { channel_shared: true } }',
    ],
)
@pytest.mark.parametrize("name", ["old.caffemodel", "old.caffemodel.h5"])
def test_weights_with_leading_axes_of_one(
    net_of: MakeNet, here: Path, layer: str, name: str
) -> None:
    """Older versions of Caffe stored four axes, other programs any number."""
    old, net = net_of(X + layer), net_of(X + layer)
    for blob in old.params["a"]:
        blob.data[...] += 1
        blob.reshape(1, 1, *blob.shape)
    old.save(name)
    net.copy_from(name)
    for found, blob in zip(net.params["a"], old.params["a"]):
        assert np.array_equal(found.data, blob.data[0, 0])


def test_nets_share_parameters_and_not_their_gradients(net_of: MakeNet) -> None:
    text = "force_backward: true " + ONE
    one, two = net_of(text), net_of(text, seed=2)
    two.share_params(one)
    weight = one.params["a"][0]
    assert np.shares_memory(weight.data, two.params["a"][0].data)
    weight.diff[...] = 5
    two.forward()
    two.backward(a=np.ones(two.blobs["a"].shape))
    two.clear_param_diffs()
    assert (weight.diff == 5).all()


@pytest.mark.parametrize("how", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_net_is_not_copied(net_of: MakeNet, how: Callable[[object], object]) -> None:
    """Copying or pickling raises an error, because the copy would share some blobs with the net."""
    with pytest.raises(netlib.NetlibError, match="a net cannot be copied or pickled"):
        how(net_of(ONE))


@pytest.mark.parametrize("other", ["shape", "dtype"])
def test_nets_that_cannot_share_parameters_share_none(net_of: MakeNet, other: str) -> None:
    one = net_of(TWO)
    if other == "shape":
        two = net_of(TWO.replace("num_output: 3", "num_output: 4"))
        message = "layer 'a' has"
    else:
        two = net_of(TWO, dtype=np.float64)
        message = "layer 'a' is in float32"
    with pytest.raises(netlib.LayerError, match=message):
        one.share_params(two)
    assert not np.shares_memory(one.params["a"][0].data, two.params["a"][0].data)


def test_stages_are_added_to_those_of_the_file(net_of: MakeNet) -> None:
    text = X + "".join(
        f'layer {{ name: "{s}" type: "Silence" bottom: "x" include {{ stage: "{s}" }} }}'
        for s in "st"
    )
    net = net_of(text + 'state { stage: "s" }', stages=["t"])
    assert {"s", "t"} <= set(net.layer_dict)


def test_weights_that_lack_a_layer(
    net_of: MakeNet, here: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A layer without weights in the file keeps its initial values, as in pycaffe, and a
    note is logged.
    """
    small = net_of(ONE)
    small.save("w.caffemodel")
    Path("net.prototxt").write_text(TWO)
    net = netlib.Net("net.prototxt", "w.caffemodel", netlib.TEST)
    assert np.array_equal(net.params["a"][0].data, small.params["a"][0].data)
    assert caplog.messages == ["w.caffemodel has no weights for b; they keep their initial values"]


WEIGHED = """force_backward: true
layer { name: "a" type: "Input" top: "a" input_param { shape { dim: 3 dim: 4 } } }
layer { name: "b" type: "Input" top: "b" input_param { shape { dim: 3 dim: 4 } } }
layer { name: "l" type: "%s" bottom: "a" bottom: "b" top: "loss" loss_weight: 3 }"""


@pytest.mark.parametrize("kind", ["EuclideanLoss", "Eltwise"])
@pytest.mark.parametrize("phase", [netlib.TRAIN, netlib.TEST])
def test_the_diff_of_a_loss_is_its_weight_from_the_start(net_of, kind, phase):
    """As in Caffe, the weight is written when the net is built; after a reshape it is
    written again.
    """
    net = net_of(WEIGHED % kind, phase)
    assert np.array_equal(net.blobs["loss"].diff, np.full(net.blobs["loss"].shape, 3))
    for name in "ab":
        net.blobs[name].reshape(5, 4)
    net.reshape()
    assert np.array_equal(net.blobs["loss"].diff, np.full(net.blobs["loss"].shape, 3))


def test_a_diff_written_before_the_first_backward_is_kept(net_of):
    net = net_of(WEIGHED % "EuclideanLoss")
    net.blobs["loss"].diff[...] = 2
    for _ in range(2):
        net.forward(a=np.ones((3, 4)), b=np.zeros((3, 4)))
        assert net.backward()["a"] == pytest.approx(np.full((3, 4), 2 / 3))
    found = net.backward(loss=net.blobs["loss"].diff)["a"]
    assert found == pytest.approx(np.full((3, 4), 2 / 3))
