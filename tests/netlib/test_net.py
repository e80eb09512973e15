"""Net: what is built from a prototxt, where gradients flow, how weights come and go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from netlib import prototxt
from netlib.messages import NetState, NetStateRule, SolverParameter
from netlib.net_parameter import load_parameter, meets

MakeNet = Callable[..., netlib.Net]

X = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } } '


def ip(name: str, bottom: str, top: str, more: str = "", outputs: int = 3) -> str:
    """An InnerProduct layer."""
    return (
        f'layer {{ name: "{name}" type: "InnerProduct" bottom: "{bottom}" top: "{top}" {more} '
        f'inner_product_param {{ num_output: {outputs} weight_filler {{ type: "xavier" }} }} }} '
    )


def loss(bottom: str, more: str = "") -> str:
    """A loss on a blob of 2 x 3, against an input ``t``."""
    return (
        'layer { name: "t" type: "Input" top: "t" input_param { shape { dim: 2 dim: 3 } } } '
        f'layer {{ name: "loss" type: "EuclideanLoss" bottom: "{bottom}" bottom: "t" top: "loss" {more} }} '
    )


def names(net: netlib.Net) -> list[str]:
    """Names of the layers, without the inserted splits."""
    return [layer.name for layer in net.layers if layer.type != "Split"]


def backwards(net: netlib.Net) -> dict[str, list[bool]]:
    """Layers that run backwards, and for which bottoms."""
    return {at.layer.name: at.propagate_down for at in net.connections if at.needs_backward}


def rng() -> np.random.Generator:
    """The numbers of these tests."""
    return np.random.default_rng(0)


# ---------------------------------------------------------------------------------------------- which layers


@pytest.mark.parametrize(
    ("rule", "state", "expected"),
    [
        (NetStateRule(), NetState("TRAIN"), True),
        (NetStateRule(phase="TEST"), NetState("TRAIN"), False),
        (NetStateRule(min_level=2), NetState(level=1), False),
        (NetStateRule(min_level=2, max_level=3), NetState(level=3), True),
        (NetStateRule(max_level=3), NetState(level=4), False),
        (NetStateRule(stage=("a", "b")), NetState(stage=("a",)), False),
        (NetStateRule(stage=("a", "b")), NetState(stage=("b", "a")), True),
        (NetStateRule(not_stage=("a",)), NetState(stage=("a", "b")), False),
        (NetStateRule(phase="TRAIN", stage=("a",)), NetState("TRAIN", stage=("a",)), True),
    ],
)
def test_a_rule_is_met_when_all_its_conditions_are(rule: NetStateRule, state: NetState, expected: bool) -> None:
    """Phase, levels, all stages, no excluded stage."""
    assert meets(state, rule) == expected


RULES = X + "".join(
    f'layer {{ name: "{name}" type: "Power" bottom: "x" top: "{name}" {rules} }} '
    for name, rules in {
        "train": "include { phase: TRAIN }",
        "test": "include { phase: TEST }",
        "deep": "include { min_level: 1 }",
        "not_a": 'exclude { stage: "a" }',
        "a_or_test": 'include { stage: "a" } include { phase: TEST }',
        "never_both": 'exclude { phase: TRAIN } exclude { stage: "a" }',
    }.items()
)


@pytest.mark.parametrize(
    ("phase", "options", "expected"),
    [
        (netlib.TRAIN, {}, ["x", "train", "not_a"]),
        (netlib.TEST, {}, ["x", "test", "not_a", "a_or_test", "never_both"]),
        (netlib.TRAIN, {"level": 1, "stages": ["a"]}, ["x", "train", "deep", "a_or_test"]),
        (netlib.TEST, {"stages": ["a"]}, ["x", "test", "a_or_test"]),
    ],
)
def test_include_and_exclude(net_of: MakeNet, phase: int, options: dict, expected: list[str]) -> None:
    """Any include suffices; any exclude excludes."""
    assert names(net_of(RULES, phase, **options)) == expected


def test_the_state_may_stand_in_the_net(net_of: MakeNet) -> None:
    """Phase, level and stages of ``state { }`` hold where the caller gives none."""
    net = netlib.Net(prototxt.parse('state { phase: TRAIN level: 1 stage: "a" } ' + RULES))
    assert net.phase == netlib.TRAIN
    assert names(net) == ["x", "train", "deep", "a_or_test"]


def test_include_and_exclude_together_are_a_mistake(net_of: MakeNet) -> None:
    """As in Caffe."""
    with pytest.raises(netlib.PrototxtError, match="layer 'p' has both include and exclude rules"):
        net_of(X + 'layer { name: "p" type: "Power" bottom: "x" top: "p" include { } exclude { } }')


@pytest.mark.parametrize(
    ("text", "shapes"),
    [
        ('input: "a" input_dim: 2 input_dim: 3 input_dim: 4 input_dim: 5', {"a": (2, 3, 4, 5)}),
        ('input: "a" input_shape { dim: 2 dim: 3 }', {"a": (2, 3)}),
        ('input: "a" input: "b" input_shape { dim: 2 } input_shape { dim: 3 }', {"a": (2,), "b": (3,)}),
        ('input: "a" input: "b" ' + "input_dim: 1 " * 4 + "input_dim: 2 " * 4, {"a": (1,) * 4, "b": (2,) * 4}),
        (
            'layer { name: "a" type: "Input" top: "a" top: "b" input_param { shape { dim: 2 } } }',
            {"a": (2,), "b": (2,)},
        ),
    ],
)
def test_inputs_old_and_new(net_of: MakeNet, text: str, shapes: dict[str, tuple[int, ...]]) -> None:
    """``input_dim`` counts four an input, ``input_shape`` one per input, an Input layer one per top or one for all."""
    net = net_of(text)
    assert net.inputs == list(shapes)
    assert {name: blob.shape for name, blob in net.blobs.items()} == shapes


@pytest.mark.parametrize(
    "text", ['input: "a" input_dim: 1', 'input: "a" input: "b" input: "c" input_shape { } input_shape { }']
)
def test_inputs_without_a_fitting_shape(net_of: MakeNet, text: str) -> None:
    """The message counts."""
    with pytest.raises(netlib.PrototxtError, match="inputs need as many input_shape"):
        net_of(text)


def test_the_constructor_is_pycaffes(net_of: MakeNet, tmp_path: Path) -> None:
    """Net(file, phase), Net(file, weights, phase), Net(file, phase=, weights=)."""
    (tmp_path / "net.prototxt").write_text(X + ip("ip", "x", "y"))
    first = netlib.Net(str(tmp_path / "net.prototxt"), netlib.TRAIN, seed=3)
    first.save(tmp_path / "w.h5")
    for net in (
        netlib.Net(tmp_path / "net.prototxt", tmp_path / "w.h5", netlib.TEST),
        netlib.Net(tmp_path / "net.prototxt", phase=netlib.TEST, weights=tmp_path / "w.h5"),
    ):
        assert net.phase == netlib.TEST
        assert np.array_equal(net.params["ip"][0].data, first.params["ip"][0].data)


def test_set_random_seed_decides_the_weights(net_of: MakeNet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of nets and solvers that have no seed of their own; as in Caffe, each that is made gets other numbers."""
    monkeypatch.setattr(netlib.net, "_seeds", None)
    tree = prototxt.parse(X + ip("ip", "x", "y"))
    options = SolverParameter(net_param=tree, base_lr=0.1, lr_policy="fixed")
    found = []
    for seed in (1, 1, 2):
        netlib.set_random_seed(seed)
        nets = [netlib.Net(tree, netlib.TRAIN), netlib.Net(tree, netlib.TRAIN), netlib.Solver(options).net]
        found.append([net.params["ip"][0].data.tolist() for net in nets])
    assert found[0] == found[1]
    assert all(one != two for one, two in zip(found[1], found[2]))
    assert found[0][0] != found[0][1] != found[0][2]


# ---------------------------------------------------------------------------------------------- running


def test_forward_takes_inputs_and_gives_outputs(net_of: MakeNet) -> None:
    """By name; more blobs on request; outputs are what no layer reads."""
    net = net_of(X + ip("a", "x", "a") + ip("b", "a", "b"))
    x = rng().normal(size=(2, 3)).astype(np.float32)
    found = net.forward(["a"], x=x)
    assert sorted(found) == ["a", "b"]
    assert net.outputs == ["b"]
    w, b = (p.data for p in net.params["a"])
    assert np.allclose(found["a"], x @ w.T + b)


def test_a_new_batch_size_reshapes_the_net(net_of: MakeNet) -> None:
    """By the array that is given, or by hand."""
    net = net_of(X + ip("a", "x", "a"))
    assert net.forward(x=np.ones((5, 3)))["a"].shape == (5, 3)
    net.blobs["x"].reshape(4, 3)
    net.reshape()
    assert net.forward()["a"].shape == (4, 3)


def test_a_new_batch_size_for_two_inputs_that_must_agree(net_of: MakeNet) -> None:
    """Both are given a new shape before the net is shaped."""
    net = net_of(X + loss("x"))
    found = net.forward(x=np.ones((5, 3)), t=np.zeros((5, 3)))
    assert float(found["loss"]) == pytest.approx(1.5)


def test_forward_from_one_layer_to_another(net_of: MakeNet) -> None:
    """Both are included; what lies outside keeps its values."""
    net = net_of(X + ip("a", "x", "a") + ip("b", "a", "b") + ip("c", "b", "c"))
    x = np.ones((2, 3))
    whole = {name: net.forward(["a", "b"], x=x)[name].copy() for name in "abc"}
    net.blobs["a"].data[...] = 0
    found = net.forward(start="b", end="b")
    assert list(found) == ["b"]
    assert np.allclose(found["b"], net.params["b"][1].data)
    assert np.array_equal(net.blobs["c"].data, whole["c"])
    assert np.allclose(net.forward(end="a")["a"], whole["a"])
    assert np.allclose(net.forward(start="b")["c"], whole["c"])


def test_backward_from_one_layer_to_another(net_of: MakeNet) -> None:
    """From ``start`` down to ``end``."""
    net = net_of("force_backward: true " + X + ip("a", "x", "a") + ip("b", "a", "b"))
    net.forward(x=np.ones((2, 3)))
    found = net.backward(["a"], end="b", b=np.ones((2, 3)))
    assert np.allclose(found["a"], np.ones((2, 3)) @ net.params["b"][0].data)
    assert list(found) == ["a"]  # the bottoms of the last layer
    assert not net.blobs["x"].diff.any()
    net.backward(start="a")
    assert np.allclose(net.blobs["x"].diff, net.blobs["a"].diff @ net.params["a"][0].data)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda net: net.forward(y=np.ones(3)), "has no input 'y'.*its inputs: x"),
        (lambda net: net.forward(x=np.ones(3)), r"input 'x' has shape \(2, 3\).* given an array.* \(3,\)"),
        (lambda net: net.forward(start="aa"), r"has no layer 'aa' \(did you mean 'a'\?\)"),
        (lambda net: net.forward(["aaa"]), "has no blob 'aaa'"),
        (
            lambda net: net.forward(x=np.ma.masked_equal(np.ones((2, 3)), 0)),
            "input 'x' takes all of an array, given one",
        ),
        (lambda net: net.forward(x=np.full((2, 3), "a")), "input 'x' takes numbers, given an array of <U1"),
        (lambda net: net.backward(bb=np.ones(3)), "has no blob 'bb'"),
        (lambda net: net.backward(a=np.ones(7)), r"output 'a' has shape \(2, 3\), given an array of shape \(7,\)"),
        (lambda net: net.backward(a=np.ma.masked_equal(np.ones((2, 3)), 0)), "output 'a' takes all of an array"),
    ],
)
def test_unknown_names_are_told(net_of: MakeNet, call: Callable[[netlib.Net], object], message: str) -> None:
    """With the known ones, or the nearest."""
    with pytest.raises(netlib.NetlibError, match=message):
        call(net_of(X + ip("a", "x", "a")))


def test_float64_nets(net_of: MakeNet) -> None:
    """Blobs, parameters and gradients are of the net's type; whole numbers are refused."""
    net = net_of(X + ip("a", "x", "a") + loss("a"), dtype=np.float64)
    net.forward(x=rng().normal(size=(2, 3)))
    net.backward()
    arrays = [b for blob in [*net.blobs.values(), *net.params["a"]] for b in (blob.data, blob.diff)]
    assert {array.dtype for array in arrays} == {np.dtype(np.float64)}
    with pytest.raises(netlib.NetlibError, match="float32 or float64, not in int32"):
        net_of(X, dtype=np.int32)


# ---------------------------------------------------------------------------------------------- gradients


def test_a_blob_with_two_readers_sums_their_gradients(net_of: MakeNet) -> None:
    """By a Split, which is Caffe's; a loss weight on the blob is one more reader."""
    text = "force_backward: true " + X + ip("a", "x", "a", "loss_weight: 2") + ip("b", "a", "b") + ip("c", "a", "c")
    net = net_of(text)
    net.forward(x=np.ones((2, 3)))
    db, dc = rng().normal(size=(2, 2, 3)).astype(np.float32)
    net.backward(b=db, c=dc)
    want = db @ net.params["b"][0].data + dc @ net.params["c"][0].data + 2
    assert np.allclose(net.blobs["a"].diff, want, rtol=1e-5)
    assert "a_a_0_split" in net.layer_dict


def test_layers_in_place_run_in_file_order(net_of: MakeNet) -> None:
    """Forwards and backwards: -2 x, then ReLU, on one blob."""
    net = net_of(
        "force_backward: true "
        + X
        + 'layer { name: "p" type: "Power" bottom: "x" top: "y" power_param { scale: -2 } } '
        'layer { name: "r" type: "ReLU" bottom: "y" top: "y" } layer { name: "q" type: "TanH" bottom: "y" top: "y" }'
    )
    x = np.array([[1, -1, 0.5], [-0.25, 0, 2]])
    net.forward(x=x)
    y = np.tanh(np.maximum(-2 * x, 0))
    assert np.allclose(net.blobs["y"].data, y, atol=1e-6)
    net.backward(y=np.ones((2, 3)))
    assert np.allclose(net.blobs["x"].diff, np.where(x < 0, -2 * (1 - y**2), 0), atol=1e-6)


def test_gradients_flow_only_where_something_learns_below_a_loss(net_of: MakeNet) -> None:
    """Frozen layers below and layers that lead to no loss do not run backwards."""
    net = net_of(
        X
        + ip("frozen", "x", "f", "param { lr_mult: 0 } param { lr_mult: 0 }")
        + ip("a", "f", "a")
        + ip("side", "a", "side")
        + ip("b", "a", "b")
        + loss("b")
    )
    splits = {name for name in backwards(net) if "split" in name}
    assert set(backwards(net)) - splits == {"a", "b", "loss"}
    assert backwards(net)["a"] == [False]
    assert backwards(net)["loss"] == [True, False]


def test_force_backward_runs_everything(net_of: MakeNet) -> None:
    """Down to the inputs, where a layer allows it: not to labels."""
    text = X + ip("frozen", "x", "f", "param { lr_mult: 0 } param { lr_mult: 0 }") + loss("f")
    net = net_of("force_backward: true " + text)
    net.forward(x=np.ones((2, 3)), t=np.zeros((2, 3)))
    net.backward()
    assert net.blobs["x"].diff.any()
    assert not backwards(net_of(text))
    text = text.replace('"EuclideanLoss"', '"SoftmaxWithLoss"').replace(
        'dim: 2 dim: 3 } } } layer { name: "loss"', 'dim: 2 } } } layer { name: "loss"'
    )
    assert backwards(net_of("force_backward: true " + text))["loss"] == [True, False]


def test_propagate_down_cuts_the_gradient(net_of: MakeNet) -> None:
    """``propagate_down: false`` stops it; below, nothing runs backwards."""
    net = net_of(X + ip("a", "x", "a") + ip("b", "a", "b", "propagate_down: false") + loss("b"))
    assert backwards(net) == {"b": [False], "loss": [True, False]}


def test_propagate_down_true_asks_for_a_gradient(net_of: MakeNet) -> None:
    """Of an input, which otherwise gets none."""
    net = net_of(X + ip("a", "x", "a", "propagate_down: true") + loss("a"))
    net.forward(x=np.ones((2, 3)))
    net.backward()
    assert net.blobs["x"].diff.any()


@pytest.mark.parametrize(
    ("weight", "layer"), [(3, "loss_weight: 3"), (1, ""), (0.5, "loss_weight: 0.5"), (-1, "loss_weight: -1")]
)
def test_loss_weight(net_of: MakeNet, weight: float, layer: str) -> None:
    """The top shows the plain loss; the net's loss and the gradients are weighted."""
    net = net_of(X + ip("a", "x", "a") + loss("a", layer))
    net.params["a"][0].data[...] = np.eye(3)
    total = None
    net.forward(x=np.ones((2, 3)), t=np.zeros((2, 3)))
    total = net.loss()
    net.backward()
    assert float(net.blobs["loss"].data) == pytest.approx(1.5)
    assert total == pytest.approx(1.5 * weight)
    assert np.allclose(net.blobs["a"].diff, weight / 2)


def test_loss_weight_on_an_ordinary_top(net_of: MakeNet) -> None:
    """The loss is the sum of its values, the gradient the weight everywhere; 0 switches a loss layer off."""
    net = net_of(X + ip("a", "x", "a", "loss_weight: 0.5"))
    net.forward(x=np.ones((2, 3)))
    net.backward()
    assert net.loss() == pytest.approx(0.5 * net.blobs["a"].data.sum(), rel=1e-5)
    assert np.allclose(net.params["a"][1].diff, 2 * 0.5)
    assert not backwards(net_of(X + ip("a", "x", "a") + loss("a", "loss_weight: 0")))


def test_param_diffs_add_up_until_they_are_cleared(net_of: MakeNet) -> None:
    """Two passes give twice the gradient."""
    net = net_of(X + ip("a", "x", "a") + loss("a"))
    net.forward(x=np.ones((2, 3)))
    net.backward()
    once = net.params["a"][0].diff.copy()
    net.backward()
    assert np.allclose(net.params["a"][0].diff, 2 * once)
    net.clear_param_diffs()
    assert not net.params["a"][0].diff.any()
    net.params["a"][0].diff[...] = np.nan
    net.clear_param_diffs()
    net.backward()
    assert np.allclose(net.params["a"][0].diff, once)


# ---------------------------------------------------------------------------------------------- shared parameters


def shared(mode: str = "", more: str = "") -> str:
    """Two layers whose weights have one name."""
    return (
        X
        + ip("a", "x", "a", 'param { name: "w" lr_mult: 2 decay_mult: 1 }')
        + ip("b", "a", "b", f'param {{ name: "w" {mode} }} {more}')
    )


def test_shared_parameters_are_one(net_of: MakeNet) -> None:
    """One blob, one entry to learn, the gradients of both layers in it."""
    net = net_of(shared() + loss("b"), dtype=np.float64)
    assert np.shares_memory(net.params["a"][0].data, net.params["b"][0].data)
    assert np.shares_memory(net.params["a"][0].diff, net.params["b"][0].diff)
    assert [p.label for p in net.learnable] == ["a/0", "a/1", "b/1"]
    x = rng().normal(size=(2, 3))
    net.forward(x=x)
    net.backward()
    da, db = net.blobs["a"].diff, net.blobs["b"].diff
    both = da.T @ x + db.T @ net.blobs["a"].data
    assert np.allclose(net.params["a"][0].diff, both)
    net.params["b"][0].diff[...] = np.nan
    net.clear_param_diffs()
    net.backward()
    assert np.allclose(net.params["a"][0].diff, both)


def test_permissive_sharing_wants_only_the_same_count(net_of: MakeNet) -> None:
    """A (2, 6) and a (3, 4) weight in one memory, seen in two shapes."""
    shapes = "shape { dim: 2 dim: 6 } shape { dim: 2 dim: 4 }"
    text = f'layer {{ name: "x" type: "Input" top: "x" top: "y" input_param {{ {shapes} }} }} '
    text += ip("a", "x", "a", 'param { name: "w" }', 2) + ip(
        "b", "y", "b", 'param { name: "w" share_mode: PERMISSIVE }', 3
    )
    net = net_of("force_backward: true " + text)
    assert [p.data.shape for p in (net.params["a"][0], net.params["b"][0])] == [(2, 6), (3, 4)]
    net.params["a"][0].data[0, 5] = 9
    assert net.params["b"][0].data[1, 1] == 9
    net.forward(x=np.ones((2, 6)), y=np.ones((2, 4)))
    net.backward(a=np.ones((2, 2)), b=np.zeros((2, 3)))
    assert (net.params["b"][0].diff == 2).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (X + ip("a", "x", "a", 'param { name: "w" }', 4) + ip("b", "a", "b", 'param { name: "w" }', 3),
         r"layer 'b': parameter 0 \(3, 4\) cannot share 'w' with layer 'a' parameter 0 \(4, 3\)"),
        (shared("lr_mult: 3"), "shared parameter 'w' has lr_mult 3, but 2 in layer 'a'"),
        (shared("decay_mult: 0"), "shared parameter 'w' has decay_mult 0, but 1 in layer 'a'"),
        (X + ip("a", "x", "a", "param { } param { } param { }"), "layer 'a': has 2 parameters, but 3 param blocks"),
    ],
)  # fmt: skip
def test_what_cannot_be_shared(net_of: MakeNet, text: str, message: str) -> None:
    """Other shapes, other multipliers, more param blocks than parameters."""
    with pytest.raises(netlib.LayerError, match=message):
        net_of(text)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (["lr_mult: 1 decay_mult: 1", "lr_mult: 1 decay_mult: 2"], "has decay_mult 2, but 1 in layer 'b0'"),
        (["", "lr_mult: 3", "lr_mult: 2"], "has lr_mult 2, but 3 in layer 'b1'"),
        (["lr_mult: 3", "", "decay_mult: 0", "lr_mult: 3 decay_mult: 1"], "has decay_mult 1, but 0 in layer 'b2'"),
    ],
)
def test_no_layer_may_contradict_another_about_a_shared_parameter(
    net_of: MakeNet, params: list[str], message: str
) -> None:
    """Whichever layers say it, and whatever else they agree on."""
    text = X
    for i, param in enumerate(params):
        text += ip(f"b{i}", f"b{i - 1}" if i else "x", f"b{i}", f'param {{ name: "w" {param} }}')
    with pytest.raises(netlib.LayerError, match=f"layer 'b{len(params) - 1}': shared parameter 'w' {message}"):
        net_of(text)


def test_multipliers_of_a_shared_parameter_may_stand_in_either_layer(net_of: MakeNet) -> None:
    """What only one of them says holds for both."""
    text = (
        X + ip("a", "x", "a", 'param { name: "w" lr_mult: 2 }') + ip("b", "a", "b", 'param { name: "w" decay_mult: 0 }')
    )
    owner = net_of(text).learnable[0].spec
    assert (owner.lr_mult, owner.decay_mult) == (2, 0)


def test_param_blocks_count_from_the_first(net_of: MakeNet) -> None:
    """One block leaves the bias at lr_mult 1, decay_mult 1."""
    net = net_of(X + ip("a", "x", "a", "param { lr_mult: 5 decay_mult: 0 }"))
    assert [(p.spec.lr_mult, p.spec.decay_mult) for p in net.learnable] == [(5, 0), (1, 1)]


# ---------------------------------------------------------------------------------------------- weights


def test_copy_from_copies_by_layer_name(net_of: MakeNet, tmp_path: Path) -> None:
    """From a file or a net; returns the source's layers that are not here."""
    source, net = net_of(X + ip("a", "x", "a") + ip("more", "a", "more")), net_of(X + ip("a", "x", "y"), seed=2)
    source.save(tmp_path / "w.h5")
    for origin in (source, tmp_path / "w.h5"):
        net.params["a"][0].data[...] = 0
        assert net.copy_from(origin) == (["more"], [])
        assert np.array_equal(net.params["a"][0].data, source.params["a"][0].data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (X + ip("a", "x", "a") + ip("b", "a", "b", outputs=4),
         r"layer 'b' parameter 0 has shape \(3, 3\), the net expects \(4, 3\)"),
        (X + ip("other", "x", "y"), "no layer of net '' is in it; it has a, b.*, the net has other"),
        ((X + ip("a", "x", "a") + ip("b", "a", "b")).replace("num_output: 3", "num_output: 3 bias_term: false"),
         "layer 'a' has 2 parameters, the net expects 1"),
    ],
)  # fmt: skip
def test_weights_that_do_not_fit_change_nothing(net_of: MakeNet, tmp_path: Path, text: str, message: str) -> None:
    """Not even the layers that would fit: a net is never half copied."""
    net_of(X + ip("a", "x", "a") + ip("b", "a", "b")).save(tmp_path / "w.h5")
    net = net_of(text, seed=2)
    before = [p.blob.data.copy() for p in net.learnable]
    with pytest.raises(netlib.WeightsError, match=message):
        net.copy_from(tmp_path / "w.h5")
    assert all(np.array_equal(p.blob.data, old) for p, old in zip(net.learnable, before))


def test_weights_without_a_bias_do_not_fill_half_a_layer(net_of: MakeNet, tmp_path: Path) -> None:
    """The net's second parameter is missing."""
    net_of((X + ip("a", "x", "a")).replace("num_output: 3", "num_output: 3 bias_term: false")).save(tmp_path / "w.h5")
    with pytest.raises(netlib.WeightsError, match="layer 'a' lacks parameter 1, the net has 2"):
        net_of(X + ip("a", "x", "a")).copy_from(tmp_path / "w.h5")


def test_old_four_dimensional_weights(net_of: MakeNet, tmp_path: Path) -> None:
    """Caffe once stored every parameter with four axes."""
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file["data/a/0"] = np.arange(9, dtype=np.float32).reshape(1, 1, 3, 3)
        file["data/a/1"] = np.ones((1, 1, 1, 3), np.float32)
    net = net_of(X + ip("a", "x", "a"))
    net.copy_from(tmp_path / "old.h5")
    assert net.params["a"][0].data[2].tolist() == [6, 7, 8]


def test_shared_weights_are_saved_and_loaded(net_of: MakeNet, tmp_path: Path) -> None:
    """The sharing layer's group is empty; its other parameters have their index."""
    one, two = net_of(shared()), net_of(shared(), seed=2)
    one.params["b"][1].data[...] = 4
    one.save(tmp_path / "w.h5")
    two.copy_from(tmp_path / "w.h5")
    for name, params in one.params.items():
        for mine, theirs in zip(two.params[name], params):
            assert np.array_equal(mine.data, theirs.data)


# ---------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ip("a", "nothing", "a"), r"net.prototxt:1:\d+: error: layer 'a': unknown bottom blob 'nothing'; known here"),
        (ip("a", "xx", "a"), r"unknown bottom blob 'xx' \(did you mean 'x'\?\)"),
        (ip("a", "x", "a") + ip("b", "x", "a"), "layer 'b': top blob 'a' is already written by layer 'a'"),
        (
            'layer { name: "g" type: "Input" top: "g" input_param { shape { dim: 2 dim: 3 } } }'
            'layer { name: "s" type: "Scale" bottom: "x" bottom: "g" top: "g" }',
            r"top blob 'g' is already written by layer 'g'; .* of the bottom in the same place \(0\) to run in place",
        ),
        (ip("a", "x", "x"), "InnerProduct cannot run in place, but 'x' is both bottom and top"),
        (ip("a", "x", "a", 'bottom: "x"'), "layer 'a': has 2 bottoms, InnerProduct takes 1"),
        (ip("a", "x", "a", 'top: "b"'), "layer 'a': has 2 tops, InnerProduct takes 1"),
        ('layer { name: "c" type: "Concat" top: "c" }', "has 0 bottoms, Concat takes at least 1"),
        (ip("a", "x", "a", "loss_weight: 1 loss_weight: 2"), "has 1 tops, but 2 loss_weight"),
        (ip("a", "x", "a", "propagate_down: true propagate_down: true"), "has 1 bottoms, but 2 propagate_down"),
        (loss("x").replace("dim: 2 dim: 3", "dim: 2 dim: 4"),
         r"layer 'loss': bottoms 'x' \(2, 3\) and 't' \(2, 4\) must have the same number"),
    ],
)  # fmt: skip
def test_mistakes_name_layer_blob_and_shapes(net_of: MakeNet, text: str, message: str) -> None:
    """One line, with the place in the file."""
    with pytest.raises(netlib.LayerError, match=message) as error:
        net_of(X + text)
    assert str(error.value).startswith("net.prototxt:1:")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('layer { name: "a" type: "Convolutoin" }', r"type 'Convolutoin' \(did you mean 'Convolution'\?\); known"),
        ('layer { name: "a" }', "layer 'a' has no type"),
        ("", "no layer in this file; expected a net"),
        ('layers { name: "a" }', "layer 'a' has no type"),
        ('layers { name: "a" type: "RELU" }', "'type' expects .*, found \"RELU\""),
        ('layers { name: "a" type: RELUU }', r"unknown value RELUU of 'type' \(did you mean 'RELU'\?\)"),
        ('layers { type: RELU } layer { type: "ReLU" }', "both 'layer' and 'layers'"),
        ('layer { name: "x" type: "Power" power_parm { } }', "unknown field 'power_parm'"),
        ('layer { name: "x" type: "Power" powwer_param { } }', r"'powwer_param' \(did you mean 'power_param'\?\)"),
        ('layer { name: "x" type: "Power" bottom: "x" top: "y" power_param { scael: 2 } }',
         r"unknown field 'scael' \(did you mean 'scale'\?\)"),
    ],
)  # fmt: skip
def test_mistakes_in_the_text_of_a_net(net_of: MakeNet, text: str, message: str) -> None:
    """Unknown types and fields come with the nearest known one."""
    with pytest.raises(netlib.PrototxtError, match=message):
        net_of(text)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('layer { name: "b" type: "BN" bn_param { bn_mode: LEARN } }', "1:19: error: unknown layer type 'BN'"),
        ('layer { name: "b" type: "BatchNorm" bn_param { } }', "1:37: error: unknown field 'bn_param'"),
        ('layers { name: "b" type: BN bn_param { } }', "1:26: error: unknown value BN of 'type'"),
        ('layers { name: "b" type: RELU bn_param { } }', "1:31: error: unknown field 'bn_param'"),
    ],
)
def test_a_layer_of_a_fork_of_caffe(net_of: MakeNet, text: str, found: str) -> None:
    """By its type or by its options: what there is instead. A blob may have its name."""
    advice = r" \(the layer BN and its bn_param are of forks of Caffe.*; expected two layers, BatchNorm and Scale with"
    with pytest.raises(netlib.PrototxtError, match=found + advice):
        net_of(text)
    with pytest.raises(netlib.LayerError, match="unknown bottom blob 'BN'; known"):
        net_of(X + ip("a", "BN", "a"))


def test_two_layers_of_one_name(net_of: MakeNet, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As in Caffe both run; here, unlike there, both also keep their weights, under names of their own."""
    text = X + ip("a", "x", "a") + 'layer { name: "r" type: "ReLU" bottom: "a" top: "a" } ' + ip("a", "a", "b")
    net = net_of(text + 'layer { name: "r" type: "ReLU" bottom: "b" top: "b" }')
    assert list(net.layer_dict) == ["x", "a", "r", "a (2)", "r (2)"]
    assert [message.split(": a second")[1] for message in caplog.messages] == [
        " layer is called 'a'; its parameters are those of 'a (2)' here, in Caffe those of the first are loaded twice"
    ]
    net.params["a (2)"][0].data[...] = 7
    for name in ("w.caffemodel", "w.caffemodel.h5"):
        net.save(tmp_path / name)
        again = net_of(text)
        again.copy_from(tmp_path / name, strict=True)
        assert (again.params["a (2)"][0].data == 7).all()
        assert np.array_equal(again.params["a"][0].data, net.params["a"][0].data)


def test_a_name_that_a_repeated_one_would_get(net_of: MakeNet) -> None:
    """No layer takes the place of another."""
    names = ["a", "a (2)", "a", "a (3)", "a"]
    net = net_of(X + "".join(ip(name, "x", f"y{i}") for i, name in enumerate(names)))
    assert [layer.name for layer in net.layers if layer.blobs] == ["a", "a (2)", "a (4)", "a (3)", "a (5)"]
    assert len(net.params) == len(names)


def test_a_phase_that_is_none(net_of: MakeNet) -> None:
    """Only 0 and 1 are phases."""
    for phase in (-1, 2):
        with pytest.raises(netlib.NetlibError, match=rf"phase {phase} is unknown; expected 0 \(TRAIN\) or 1 \(TEST\)"):
            net_of(X, phase=phase)


@pytest.mark.parametrize(("below", "notes"), [("Sigmoid", 1), ("TanH", 1), ("ReLU", 0), ("BNLL", 0)])
def test_a_gradient_that_will_be_wrong_is_said(
    net_of: MakeNet, caplog: pytest.LogCaptureFixture, below: str, notes: int
) -> None:
    """Sigmoid needs its top backwards; a layer in place behind it overwrites that. Caffe computes it and is silent."""
    text = X + ip("a", "x", "a") + f'layer {{ name: "s" type: "{below}" bottom: "a" top: "s" }} '
    text += 'layer { name: "p" type: "Power" bottom: "s" top: "s" power_param { scale: 3 } } '
    net_of(text)  # nothing runs backwards: nothing to say
    assert caplog.messages == []
    net_of(text + 'layer { name: "l" type: "EuclideanLoss" bottom: "s" bottom: "x" top: "l" }')
    assert len(caplog.messages) == notes
    if notes:
        assert "layer 'p' overwrites blob 's', which the gradient of layer 's' needs: it will be wrong" in caplog.text


def test_a_loss_may_go_without_a_top(net_of: MakeNet) -> None:
    """Caffe calls it "(automatic)"; it counts, and is no output."""
    net = net_of(X + ip("a", "x", "a") + 'layer { name: "l" type: "EuclideanLoss" bottom: "a" bottom: "x" }')
    named = net_of(X + ip("a", "x", "a") + 'layer { name: "l" type: "EuclideanLoss" bottom: "a" bottom: "x" top: "l" }')
    for one in (net, named):
        one.blobs["x"].data[...] = 1
        one.params["a"][0].data[...] = 2
        one.run_forward()
        one.run_backward()
    assert net.loss() == named.loss() > 0
    assert np.array_equal(net.params["a"][0].diff, named.params["a"][0].diff)
    assert (net.outputs, named.outputs) == ([], ["l"])
    assert [name for _, _, name in net.losses] == ["(automatic)"]


def test_weights_that_lack_a_layer(net_of: MakeNet, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The layer keeps its initial values, as in pycaffe; here it is said."""
    small, text = net_of(X + ip("a", "x", "a")), X + ip("a", "x", "a") + ip("b", "a", "b")
    small.save(tmp_path / "w.caffemodel")
    path = tmp_path / "net.prototxt"
    path.write_text(text)
    net = netlib.Net(path, tmp_path / "w.caffemodel", netlib.TEST)
    assert np.array_equal(net.params["a"][0].data, small.params["a"][0].data)
    assert caplog.messages == [f"{tmp_path}/w.caffemodel has no weights for b; they keep their initial values"]


def test_options_of_another_layer_type_are_ignored(net_of: MakeNet) -> None:
    """As in Caffe; also if they make no sense."""
    net = net_of(X + 'layer { name: "p" type: "Power" bottom: "x" top: "p" tanh_param { nothing: 1 } }')
    assert np.array_equal(net.forward(x=np.full((2, 3), 5))["p"], np.full((2, 3), 5))


def test_a_reshape_that_no_longer_fits_the_weights(net_of: MakeNet) -> None:
    """The layer says what it has and what it expects."""
    net = net_of(X + ip("fc2", "x", "y"))
    with pytest.raises(netlib.LayerError, match=r"layer 'fc2': bottom 'x' has 4 features \(4,\), its weights expect 3"):
        net.forward(x=np.ones((2, 4)))


def test_a_printed_net_is_the_same_net(net_of: MakeNet) -> None:
    """Parsed again from its own print."""
    text = str(prototxt.parse(RULES))
    assert load_parameter(prototxt.parse(text)) == load_parameter(prototxt.parse(RULES))


@pytest.mark.parametrize(
    ("shape", "layer", "message"),
    [
        ("dim: 2 dim: 0", 'type: "Softmax" top: "y"', r"bottom 'x' \(2, 0\) is empty; Softmax expects values"),
        ("dim: 2 dim: 0 dim: 4 dim: 4",
         'type: "Convolution" top: "y" convolution_param { num_output: 3 kernel_size: 3 }',
         r"layer 'l': bottom 'x' \(2, 0, 4, 4\) has no channels"),
        ("dim: 1 dim: 1 dim: 8 dim: 8",
         'type: "Pooling" top: "y" pooling_param { pool: AVE kernel_size: 3 stride: 9223372036854775808 }',
         "net.prototxt:1:203: error: 'stride' expects an integer from 0 to 4294967295, found 9223372036854775808"),
        ("dim: 1 dim: 47 dim: 8 dim: 8", 'bottom: "x" type: "HandAugment" top: "y" top: "y"',
         "top blob 'y' is already written by layer 'l'"),
        ("dim: 1 dim: 1 dim: 8 dim: 8",
         'type: "Pooling" top: "y" pooling_param { pool: AVE kernel_size: 4294967295 pad: 4294967294 }',
         "layer 'l': blob 'y': a blob cannot have the shape .*: no computer has so much memory: lower kernel_size"),
    ],
    ids=["no classes", "no channels", "a stride beyond 32 bits", "two tops of one name", "a huge window"],
)  # fmt: skip
def test_what_layers_cannot_compute(net_of: MakeNet, shape: str, layer: str, message: str) -> None:
    """A line with the layer, the blob and what was expected; no error of NumPy's."""
    text = f'layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ {shape} }} }} }} '
    with pytest.raises(netlib.NetlibError, match=message):
        net_of(f'{text} layer {{ name: "l" bottom: "x" {layer} }}').forward()
