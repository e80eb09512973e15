"""Running slice by slice gives the same values in all blobs as layer by layer."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from fast import slices
from fast.slices import SlicedStep
from netlib.errors import NetlibError
from tests.support.nets import inputs

Agree = MakeNet = Callable[..., netlib.Net]
Arrays = dict[str, np.ndarray]

PAPER = """
    layer { name: "depth" type: "Input" top: "depth" input_param { shape { dim: 2 dim: 1 dim: 128 dim: 128 } } }
    layer { name: "c1" type: "Convolution" bottom: "depth" top: "c1"
            convolution_param { num_output: 8 kernel_size: 5
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r1" type: "ReLU" bottom: "c1" top: "c1" }
    layer { name: "p1" type: "Pooling" bottom: "c1" top: "p1" pooling_param { kernel_size: 4 stride: 4 } }
    layer { name: "c2" type: "Convolution" bottom: "p1" top: "c2"
            convolution_param { num_output: 8 kernel_size: 5
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r2" type: "ReLU" bottom: "c2" top: "c2" }
    layer { name: "p2" type: "Pooling" bottom: "c2" top: "p2" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "c3" type: "Convolution" bottom: "p2" top: "c3"
            convolution_param { num_output: 8 kernel_size: 3
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r3" type: "ReLU" bottom: "c3" top: "c3" }
    layer { name: "fc" type: "InnerProduct" bottom: "c3" top: "fc"
            inner_product_param { num_output: 10 weight_filler { type: "xavier" } } }
    layer { name: "label" type: "Input" top: "label" input_param { shape { dim: 2 dim: 10 } } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "fc" bottom: "label" top: "loss" }
"""
UNSTORED = ["c1", "p1", "c2", "p2"]


@pytest.fixture(autouse=True)
def slices_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small batch is one slice.

    Products of other sizes round differently, and the values under a pooling window over the
    background are equal up to rounding, so the winner would change.
    """
    monkeypatch.setattr(slices, "SPLITS", ())


def batch(count: int, seed: int = 0, flat: bool = True) -> Arrays:
    """Images like depth crops with an object before a constant background, and labels.

    One image is only background.

    Unless ``flat``, the background is rough. On a flat background the values of a convolution are
    equal except for rounding, so a max pooling after it may pass the gradient to any of them.
    """
    rng = np.random.default_rng(seed)
    x = np.ones((count, 1, 128, 128), np.float32)
    if not flat:
        x[...] = rng.uniform(0.5, 1, x.shape)
    for i in range(count):
        if i != 1:
            top, left = rng.integers(0, 100, 2)
            hand = x[i, 0, top : top + 60, left : left + 50]
            hand[...] = rng.uniform(-1, 1, hand.shape)
    return {"depth": x, "label": rng.normal(size=(count, 10)).astype(np.float32)}


def unstored(net: netlib.Net) -> list[str]:
    """Names of the blobs that are not stored."""
    blobs = {blob for step in net.steps for blob in step.unstored}
    return [name for name, blob in net.blobs.items() if blob in blobs]


def layer_by_layer(net: netlib.Net) -> netlib.Net:
    """Run a part of a net, so that it runs layer by layer from then on; returns the net."""
    net.forward(end=net.layers[-1].name)
    return net


def feed(net: netlib.Net, inputs: Arrays) -> None:
    """Run a batch of any size forwards."""
    for name, array in inputs.items():
        net.blobs[name].reshape(array.shape)
    net.reshape()
    net.forward(**inputs)


def everything(net: netlib.Net, inputs: Arrays) -> Arrays:
    """Outputs and all gradients of one pass, forward and backward."""
    net.clear_param_diffs()
    feed(net, inputs)
    net.backward()
    found = {name: net.blobs[name].data.copy() for name in net.outputs}
    found.update({f"d{name}": net.blobs[name].diff.copy() for name in net.inputs})
    return {**found, **{p.label: p.blob.diff.copy() for p in net.learnable}}


def difference(got: np.ndarray, want: np.ndarray) -> float:
    """Relative difference max |got - want| / max |want|."""
    assert got.shape == want.shape
    return float(np.abs(got - want).max(initial=0) / max(np.abs(want).max(initial=0), 1e-30))


def assert_close(got: Arrays, want: Arrays, tolerance: float) -> None:
    """Assert that the relative difference of every array is within the tolerance."""
    assert got.keys() == want.keys()
    for name, array in want.items():
        assert difference(got[name], array) <= tolerance, name


def assert_equal(got: Arrays, want: Arrays) -> None:
    assert got.keys() == want.keys()
    for name, array in want.items():
        assert np.array_equal(got[name], array), name


def interrupt(*args: object) -> None:
    raise KeyboardInterrupt


def is_sliced(net: netlib.Net) -> bool:
    """Whether any part of the net runs in slices."""
    return any(isinstance(step, SlicedStep) for step in net.steps)


@pytest.mark.parametrize("items", [1, 2, 5, 10])
@pytest.mark.parametrize(
    "start", ["", "force_backward: true "], ids=["training", "with the image's gradient"]
)
@pytest.mark.parametrize("engine", ["plain", "fast"])
def test_slices_give_what_layer_by_layer_gives(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch, start: str, items: int, engine: str
) -> None:
    """Results in float64 are equal up to rounding, with both engines and 1, 2 and 4 slices.

    In training, the first convolution computes only windows that are not background.
    """
    monkeypatch.setattr(slices, "MAX_SLICE", 4)
    sliced = net_of(start + PAPER, dtype=np.float64)
    plain = layer_by_layer(net_of(start + PAPER, engine=engine, dtype=np.float64))
    inputs = batch(items, flat=not start)
    got, want = everything(sliced, inputs), everything(plain, inputs)
    assert is_sliced(sliced)
    assert not is_sliced(plain)
    assert_close(got, want, 1e-12)


@pytest.mark.parametrize(
    "background", ["none", "nothing else", "another value", "nothing else, and zero"]
)
def test_slices_agree_with_layer_by_layer_for_any_background(
    net_of: MakeNet, background: str
) -> None:
    inputs = batch(4)
    depth = inputs["depth"]
    if background == "none":
        depth[...] = np.random.default_rng(0).normal(size=depth.shape)
    elif background == "another value":
        depth[...] = 0.3 * depth - 2
    else:
        depth[...] = 0 if "zero" in background else 1
    expected = everything(layer_by_layer(net_of(PAPER)), inputs)
    assert_close(everything(net_of(PAPER), inputs), expected, 2e-5)


def expected_of(net_of: MakeNet, inputs: Arrays) -> dict[str, Arrays]:
    """Data and diff of every blob of the paper's network, and the parameters' diffs,
    layer by layer.
    """
    net = layer_by_layer(net_of(PAPER))
    grads = everything(net, inputs)
    return {
        "data": {name: blob.data.copy() for name, blob in net.blobs.items()},
        "diff": {name: blob.diff.copy() for name, blob in net.blobs.items()},
        "grads": grads,
    }


def check_blob(net: netlib.Net, name: str, half: str, expected: dict[str, Arrays]) -> None:
    assert difference(getattr(net.blobs[name], half), expected[half][name]) <= 2e-5, (name, half)


@pytest.mark.parametrize("when", ["before forward", "after forward", "after backward"])
@pytest.mark.parametrize("name", UNSTORED)
def test_an_unstored_blob_is_correct_whenever_it_is_accessed(
    net_of: MakeNet, name: str, when: str
) -> None:
    """It is also correct in later passes; the access changes no other value."""
    net = net_of(PAPER)
    inputs = batch(10, flat=name != "c2")
    expected = expected_of(net_of, inputs)
    if when == "before forward":
        assert not net.blobs[name].data.any()
    feed(net, inputs)
    loss = net.blobs["loss"].data.copy()
    if when == "after forward":
        check_blob(net, name, "data", expected)
        assert np.array_equal(net.blobs["loss"].data, loss)
    net.backward()
    grads = {p.label: p.blob.diff.copy() for p in net.learnable}
    check_blob(net, name, "data", expected)
    check_blob(net, name, "diff", expected)
    assert np.array_equal(net.blobs["loss"].data, loss)
    assert_equal({p.label: p.blob.diff for p in net.learnable}, grads)
    assert_close(everything(net, inputs), expected["grads"], 2e-5)
    check_blob(net, name, "data", expected)
    check_blob(net, name, "diff", expected)


def test_a_read_costs_one_pass_and_all_blobs_are_stored_from_then_on(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = net_of(PAPER)
    everything(net, batch(3))
    assert [
        (blob.shape, blob.count) for blob in net.blobs.values()
    ]  # shapes are not read from memory
    assert unstored(net) == UNSTORED
    repeated = []
    store = SlicedStep.store
    monkeypatch.setattr(SlicedStep, "store", lambda self: repeated.append(self) or store(self))
    assert all(blob.data.shape == blob.shape for blob in net.blobs.values())
    assert len(repeated) == 1
    assert unstored(net) == []


@pytest.mark.parametrize("how", ["a read", "a part"])
def test_recomputing_infinite_values_gives_no_warning(net_of: MakeNet, how: str) -> None:
    """As in the pass itself. (A warning fails the tests.)"""
    net = net_of(PAPER)
    for params in net.params.values():
        params[0].data[...] = 1e30
    everything(net, batch(3))
    if how == "a part":
        net.forward(start="c3")
    assert not np.isfinite(net.blobs["p2"].data).all()


def test_a_reshape_that_changes_nothing_loses_nothing(net_of: MakeNet) -> None:
    net, expected = net_of(PAPER), expected_of(net_of, batch(10))
    everything(net, batch(10))
    net.reshape()
    check_blob(net, "c1", "data", expected)
    check_blob(net, "p1", "diff", expected)


def test_another_number_of_items_keeps_the_plan(net_of: MakeNet) -> None:
    """The plan depends only on the shape of an item.

    The results are those of a net that has run no other batch.
    """
    net, other = net_of(PAPER), net_of(PAPER)
    everything(net, batch(5))
    steps = net.steps
    found = everything(net, batch(10))
    assert net.steps == steps
    assert_equal(found, everything(other, batch(10)))
    for name in UNSTORED:
        assert np.array_equal(net.blobs[name].data, other.blobs[name].data), name


@pytest.mark.parametrize("has_loss", [False, True])
def test_recent_numbers_of_items_need_no_new_slices(net_of: MakeNet, has_loss: bool) -> None:
    """Without a backward pass, the slices of the last few batches are kept, with
    the same results.
    """
    text = PAPER if has_loss else PAPER[: PAPER.index('layer { name: "label"')]
    net = net_of(text)
    layers: dict[int, object] = {}
    for items in (5, 10, 5, 2, 3, 4, 5):
        given = {name: array for name, array in batch(items).items() if name in net.inputs}
        feed(net, given)
        sliced = next(step for step in net.steps if isinstance(step, SlicedStep))
        layer = sliced.pieces()[0][0].layer
        assert (layers.get(items) is layer) == (items in layers and not has_loss)
        layers[items] = layer
        new = net_of(text)
        feed(new, given)
        assert np.array_equal(net.blobs["fc"].data, new.blobs["fc"].data)
    feed(net, batch(10) if has_loss else {"depth": batch(10)["depth"]})  # not among the last four
    assert sliced.pieces()[0][0].layer is not layers[10]


def test_an_unstored_blob_does_not_outlive_its_net(net_of: MakeNet) -> None:
    """Accessing an unstored blob after its net was deleted raises an error instead of
    returning zeros.
    """

    def blobs() -> dict[str, Any]:
        net = net_of(PAPER)
        feed(net, batch(2))
        return net.blobs

    left = blobs()
    gc.collect()
    assert left["fc"].data.shape == (2, 10)
    with pytest.raises(netlib.NetlibError, match="is unstored and its net is gone"):
        left["c1"].data  # noqa: B018


TWO_SIZES = """
    force_backward: true
    layer { name: "in" type: "Input" top: "x" top: "y" top: "s"
            input_param { shape { dim: 4 dim: 1 dim: 8 dim: 8 } shape { dim: 4 dim: 1 dim: 8 dim: 8 }
                          shape { dim: 4 } } }
    layer { name: "f" type: "Filter" bottom: "x" bottom: "s" top: "fx" }
    %s
"""
CONV = """
    layer { name: "%s" type: "Convolution" bottom: "%s" top: "%s"
            convolution_param { num_output: 2 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "r%s" type: "ReLU" bottom: "%s" top: "%s" }
"""
OF_X = CONV % (("cx", "fx") + ("cx",) * 4)
OF_Y = CONV % (("cy", "y") + ("cy",) * 4)


@pytest.mark.parametrize(
    "order", [OF_X + OF_Y, OF_Y + OF_X], ids=["filtered first", "filtered last"]
)
def test_blobs_of_different_numbers_of_items(
    agree: Agree, rng: np.random.Generator, order: str
) -> None:
    """Numbers of items differ between blobs after a Filter, in every pass, or if one of two
    inputs is reshaped.
    """
    x, y = rng.normal(size=(2, 6, 1, 8, 8)).astype(np.float32)
    chosen = [1, 1, 1, 1], [1, 0, 0, 1], [0, 1, 1, 1], [0, 0, 0, 0], [1, 1, 1, 1]
    batches = [{"x": x[:4], "y": y[:4], "s": np.array(items)} for items in chosen]
    net = agree(
        TWO_SIZES % order, *batches, {**batches[0], "y": y}, tolerance=1e-5, dtype=np.float32
    )
    assert [net.blobs[name].shape[0] for name in ("cx", "cy")] == [4, 6]


def test_relu_after_max_pooling_is_relu_before_it(agree: Agree) -> None:
    """Exchanging the two layers on an unstored blob changes no value, winner or gradient, including
    zeros and ties.
    """
    text = """
        force_backward: true
        layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 2 dim: 6 dim: 6 } } }
        layer { name: "c" type: "Convolution" bottom: "x" top: "c"
                convolution_param { num_output: 3 kernel_size: 1 bias_term: false } }
        layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
        layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
        layer { name: "d" type: "Convolution" bottom: "p" top: "d"
                convolution_param { num_output: 2 kernel_size: 1 weight_filler { type: "xavier" } } }
    """

    def whole_numbers(net: netlib.Net) -> None:
        net.params["c"][0].data[...] = np.array([[1, 0], [0, 1], [-1, -1]])[:, :, None, None]

    # equal values, and windows without positive ones
    x = np.random.default_rng(0).integers(-2, 2, (3, 2, 6, 6))
    net = agree(text, {"x": x}, tolerance=1e-6, dtype=np.float32, prepare=whole_numbers)
    step = next(step for step in net.steps if isinstance(step, SlicedStep))
    assert [at.layer.name for at in step.run.order] == ["c", "p", "r", "d"]


def test_a_relu_that_changed_places_leaves_the_diff_of_a_pooled_output_alone(
    net_of: MakeNet,
) -> None:
    text = """
        force_backward: true
        layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 1 dim: 6 dim: 6 } } }
        layer { name: "c" type: "Convolution" bottom: "x" top: "c"
                convolution_param { num_output: 2 kernel_size: 1 weight_filler { type: "xavier" } } }
        layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
        layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
    """
    net = net_of(text)
    dy = np.random.default_rng(0).normal(size=(3, 2, 3, 3)).astype(np.float32)
    net.forward(x=-np.ones((3, 1, 6, 6)))
    net.backward(p=dy)
    assert np.array_equal(net.blobs["p"].diff, dy)


ODD = """
    force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 1 dim: 9 dim: 8 } } }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param { num_output: 2 kernel_size: 2 weight_filler { type: "xavier" } } }
    layer { name: "f" bottom: "c" top: "c" %s }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 3 stride: 3 } }
"""


def test_only_a_monotone_layer_changes_places_with_a_max_pooling(
    agree: Agree, rng: np.random.Generator
) -> None:
    """The maximum of -x is not minus the maximum of x."""
    text = (
        ODD % 'type: "Power" power_param { scale: -1 }'
        + """
        layer { name: "d" type: "Convolution" bottom: "p" top: "d"
                convolution_param { num_output: 1 kernel_size: 1 weight_filler { type: "xavier" } } }"""
    )
    agree(text, {"x": rng.normal(size=(3, 1, 9, 8))}, tolerance=2e-5, dtype=np.float32)


def test_no_relu_changes_places_with_a_max_pooling_that_has_empty_windows(net_of: MakeNet) -> None:
    """A ReLU before the pooling does not change the value of an empty window, minus
    infinity, to 0.
    """
    text = (ODD % 'type: "ReLU"').replace("kernel_size: 3 stride: 3", "kernel_size: 1 stride: 4")
    text += """layer { name: "d" type: "Convolution" bottom: "p" top: "d"
                       convolution_param { num_output: 1 kernel_size: 1 } }"""
    x = np.random.default_rng(0).normal(size=(3, 1, 9, 8))
    for net in (net_of(text), layer_by_layer(net_of(text))):
        net.params["d"][0].data[...] = 1
        is_empty = np.isneginf(net.forward(x=x)["d"])
        assert is_empty.tolist() == [[[[False, False, True]] * 2 + [[True] * 3]]] * 3


def test_a_read_repeats_only_what_ran_in_slices(net_of: MakeNet, rng: np.random.Generator) -> None:
    """A layer that ran whole keeps its output when an unstored blob is read after its
    input was written.
    """
    net = net_of(
        inputs(x=(3, 1, 8, 8), z=(2, 1, 8, 8))
        + """layer { name: "c" type: "Convolution" bottom: "x" top: "c"
                convolution_param { num_output: 2 kernel_size: 3 weight_filler { type: "xavier" } } }
            layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
            layer { name: "r" type: "ReLU" bottom: "z" top: "r" }"""
    )
    net.forward(x=rng.normal(size=(3, 1, 8, 8)), z=rng.normal(size=(2, 1, 8, 8)))
    assert unstored(net) == ["c"]
    before = net.blobs["r"].data.copy()
    net.blobs["z"].data[...] = rng.normal(size=(2, 1, 8, 8))
    assert np.isfinite(net.blobs["c"].data).all()
    np.testing.assert_array_equal(net.blobs["r"].data, before)


CHANGES = {  # of a batch of images
    "one value": lambda x: x[0, 0, 0, 5:6].fill(0.25),
    "a square": lambda x: x[0, 0, 10:18, 10:18].fill(0.25),
    "a row": lambda x: x[0, 0, 64].fill(0.25),
    "a sign": lambda x: np.negative(x[:1, :, 3, 3], out=x[:1, :, 3, 3]),
    "NaN": lambda x: x[:1, :, 3, 3].fill(np.nan),
    "a flip": lambda x: np.copyto(x, x[..., ::-1].copy()),
    "a roll": lambda x: np.copyto(x, np.roll(x, 1)),
    "a shuffled batch": lambda x: np.copyto(x, x[::-1].copy()),
    "all": lambda x: x.fill(0.25),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_read_after_an_input_was_written_gives_the_values_of_the_pass(
    net_of: MakeNet, change: str
) -> None:
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3))
    CHANGES[change](net.blobs["depth"].data)
    for name in UNSTORED:
        check_blob(net, name, "data", expected)
        check_blob(net, name, "diff", expected)


@pytest.mark.parametrize("change", CHANGES)
def test_backward_after_an_input_was_written_is_an_error(net_of: MakeNet, change: str) -> None:
    net = net_of(PAPER)
    feed(net, batch(3))
    CHANGES[change](net.blobs["depth"].data)
    with pytest.raises(
        NetlibError, match=r"blob 'depth' was written between forward and backward.* such as 'c1'"
    ):
        net.backward()
    net.forward()
    net.backward()


def test_backward_after_a_read_may_use_new_inputs(net_of: MakeNet) -> None:
    """The net stores all blobs then, so the gradient is that of Caffe: of old blobs and
    the new input.
    """
    net, plain = net_of(PAPER), net_of(PAPER, engine="plain")
    for one in (net, plain):
        feed(one, batch(3))
        one.blobs["c1"].data  # noqa: B018
        one.blobs["depth"].data[...] = 0.5
        one.clear_param_diffs()
        one.backward()
    found, expected = ({p.label: p.blob.diff for p in one.learnable} for one in (net, plain))
    assert_close(found, expected, 2e-5)


def test_a_part_after_an_input_was_written_continues_from_the_pass(net_of: MakeNet) -> None:
    net, plain = net_of(PAPER), net_of(PAPER, engine="plain")
    for one in (net, plain):
        feed(one, batch(3))
        one.blobs["depth"].data[...] = 0.5
        one.forward(start="c2")
    assert difference(net.blobs["fc"].data, plain.blobs["fc"].data) <= 2e-5


def test_a_read_after_weights_changed_before_backward(net_of: MakeNet) -> None:
    """Diffs are those of the weights of backward, data those of the weights of forward."""
    net = net_of(PAPER, dtype=np.float64)
    plain = net_of(PAPER, engine="plain", dtype=np.float64)
    for one in (net, plain):
        feed(one, batch(3, flat=False))
        one.params["c3"][0].data[...] *= 2
        one.backward()
        one.params["c3"][0].data[...] = 0
    for name in UNSTORED:
        assert difference(net.blobs[name].data, plain.blobs[name].data) <= 1e-12, name
        assert difference(net.blobs[name].diff, plain.blobs[name].diff) <= 1e-9, name


def test_a_read_after_the_diff_of_a_top_was_written(net_of: MakeNet) -> None:
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3))
    net.blobs["c3"].diff.flat[7] += 1
    check_blob(net, "c1", "diff", expected)


@pytest.mark.parametrize("name, shape", [("depth", (5, 1, 128, 128)), ("label", (5, 10))])
def test_a_read_after_a_blob_was_reshaped(
    net_of: MakeNet, name: str, shape: tuple[int, ...]
) -> None:
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3))
    net.blobs[name].reshape(shape)
    check_blob(net, "c1", "data", expected)
    check_blob(net, "p2", "diff", expected)


def test_a_read_after_a_parameter_was_reshaped(net_of: MakeNet) -> None:
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3))
    net.params["c1"][0].reshape(8, 25)
    check_blob(net, "c1", "data", expected)


def test_diffs_of_a_pass_before_are_unknown(net_of: MakeNet) -> None:
    """Data are those of the last forward pass.

    The diffs that it has replaced are an error until the next backward.
    """
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(5))
    feed(net, batch(3))
    check_blob(net, "c1", "data", expected)
    net = net_of(PAPER)
    everything(net, batch(3, seed=1))
    feed(net, batch(3))
    check_blob(net, "c1", "data", expected)
    with pytest.raises(
        NetlibError, match=r"the diff of blob 'p1' is unknown.*read it directly after backward"
    ):
        net.blobs["p1"].diff  # noqa: B018
    net.backward()
    check_blob(net, "p1", "diff", expected)


def test_a_pass_that_fails_in_a_slice_leaves_unknown_blobs(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An access is an error. A part that computes them, or the next pass, makes them known."""
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3, seed=1))

    with monkeypatch.context() as patch:
        patch.setattr(type(net.layer_dict["p1"]), "forward", interrupt)
        with pytest.raises(KeyboardInterrupt):
            net.forward(**batch(3))
    with pytest.raises(
        NetlibError, match="the data of blob 'c2' is unknown: the last pass did not complete"
    ):
        net.blobs["c2"].data  # noqa: B018
    net.forward(end="p1")
    check_blob(net, "p1", "data", expected)
    with pytest.raises(NetlibError, match="the data of blob 'p2' is unknown"):
        net.blobs["p2"].data  # noqa: B018
    net.forward()
    check_blob(net, "p2", "data", expected)


def test_a_pass_that_fails_after_the_slices(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blobs of layers that have run have the new values, as in Caffe."""
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(3, seed=1))

    with monkeypatch.context() as patch:
        patch.setattr(net.layer_dict["fc"], "forward", interrupt)
        with pytest.raises(KeyboardInterrupt):
            net.forward(**batch(3))
    check_blob(net, "c1", "data", expected)


def test_an_unstored_blob_cannot_be_read_during_a_pass(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = net_of(PAPER)
    layer = net.layer_dict["fc"]
    forward = layer.forward

    def reading_forward(bottom: netlib.Blobs, top: netlib.Blobs) -> None:
        net.blobs["c1"].data  # noqa: B018
        forward(bottom, top)

    monkeypatch.setattr(layer, "forward", reading_forward)
    with pytest.raises(NetlibError, match="an unstored blob is read during a pass"):
        feed(net, batch(3))
    assert net.blobs["c1"].data.any()
    net.forward()


SPLIT = """
    layer { name: "a" type: "Power" bottom: "x" top: "a" power_param { shift: 1 } }
    layer { name: "split" type: "Split" bottom: "a" top: "b" top: "c" }
    %s
    layer { name: "d" type: "Eltwise" bottom: "b" bottom: "c" top: "d" }
"""


@pytest.mark.parametrize("overwritten", [False, True])
def test_tops_of_a_split_share_memory_unless_a_layer_overwrites_it(
    net_of: MakeNet, overwritten: bool
) -> None:
    over = 'layer { name: "over" type: "Exp" bottom: "b" top: "b" }' if overwritten else ""
    text = inputs(x=(1, 4)) + SPLIT % over
    fast, plain = net_of(text, engine="fast"), net_of(text, engine="plain")
    for factor in (1, 2):
        x = factor * np.arange(4.0).reshape(1, 4)
        np.testing.assert_array_equal(fast.forward(x=x)["d"], plain.forward(x=x)["d"])
    a, b, c = (fast.blobs[name].data for name in "abc")
    assert np.shares_memory(a, b) == (not overwritten)
    assert np.shares_memory(a, c)
    fast.forward(start="d")  # of a part, each blob has its own
    assert not np.shares_memory(fast.blobs["b"].data, fast.blobs["c"].data)
    np.testing.assert_array_equal(fast.blobs["c"].data, plain.blobs["c"].data)


def test_after_a_step_of_a_solver_all_blobs_have_its_values(tmp_path: Path) -> None:
    """Also those that were not stored, with dropout, and although the weights have been
    updated since.
    """
    text = PAPER.replace(
        'layer { name: "fc" type',
        'layer { name: "drop" type: "Dropout" bottom: "c3" top: "c3" } layer { name: "fc" type',
    )
    (tmp_path / "solver.prototxt").write_text(
        f'net_param {{ {text} }} base_lr: 0.1 lr_policy: "fixed" random_seed: 2'
    )
    fast, plain = (
        netlib.get_solver(tmp_path / "solver.prototxt", engine=name) for name in ("fast", "plain")
    )
    for solver in (fast, plain):
        for name, array in batch(2, flat=False).items():
            solver.net.blobs[name].data[...] = array
        solver.step(1)
    assert unstored(fast.net) == UNSTORED
    for name, blob in plain.net.blobs.items():
        assert difference(fast.net.blobs[name].data, blob.data) <= 2e-5, name
        error = np.linalg.norm(fast.net.blobs[name].diff - blob.diff)
        assert error <= 1e-2 * np.linalg.norm(blob.diff), name


BRANCHES = (
    "force_backward: true "
    + inputs(x=(3, 2, 6, 6), y=(3, 2, 6, 6))
    + "".join(
        f"""layer {{ name: "{top}" type: "Convolution" bottom: "{bottom}" top: "{top}"
            convolution_param {{ num_output: 3 kernel_size: 1 weight_filler {{ type: "xavier" }} }} }}
        """
        for bottom, top in ("xa", "ab", "bc", "yd", "de", "ef")
    )
    + "".join(
        f"""layer {{ name: "loss_{bottom}" type: "Reduction" bottom: "{bottom}" top: "loss_{bottom}"
            loss_weight: 1 reduction_param {{ operation: SUMSQ }} }}
        """
        for bottom in "cf"
    )
)
IMAGES = dict(zip("xy", np.random.default_rng(0).normal(size=(2, 3, 2, 6, 6))))


def enlarge_weights(net: netlib.Net) -> None:
    for param in net.learnable:
        param.blob.data[...] *= 1.5


def take_two_items(net: netlib.Net) -> None:
    net.blobs["x"].reshape(2, 2, 6, 6)
    net.reshape()


def reshape_to_rows(net: netlib.Net) -> None:
    net.blobs["x"].reshape(3, 2, 4, 9)
    net.blobs["y"].reshape(3, 2, 4, 9)
    net.reshape()


def run_both_ways(net: netlib.Net) -> None:
    net.forward(**IMAGES)
    net.backward()


SEQUENCES: dict[str, list[Callable[[netlib.Net], object]]] = {
    "new weights and fewer items of one input": [
        run_both_ways,
        enlarge_weights,
        take_two_items,
        netlib.Net.backward,
    ],
    "new weights, and all blobs stored for a while": [
        run_both_ways,
        netlib.Net.store_all,
        lambda net: net.store_all(False),
        enlarge_weights,
        netlib.Net.backward,
    ],
    "another shape of the same count": [run_both_ways, reshape_to_rows],
    "another shape of the same count, and a pass": [
        run_both_ways,
        reshape_to_rows,
        lambda net: net.forward(),
        netlib.Net.backward,
    ],
    "an unstored blob of another shape, and a pass": [
        run_both_ways,
        lambda net: net.blobs["a"].reshape(7),
        run_both_ways,
    ],
}


@pytest.mark.parametrize("name", SEQUENCES)
def test_sequences_of_calls_give_what_the_plain_engine_gives(net_of: MakeNet, name: str) -> None:
    nets = [net_of(BRANCHES, engine=engine, dtype=np.float64) for engine in ("plain", "fast")]
    assert unstored(nets[1]) == ["a", "b", "d", "e"]
    for net in nets:
        for call in SEQUENCES[name]:
            call(net)
    plain, fast = nets
    for blob in plain.blobs:
        for half in ("data", "diff"):
            found, expected = (getattr(net.blobs[blob], half) for net in (fast, plain))
            assert difference(found, expected) <= 1e-9, (blob, half)
    for one, other in zip(plain.learnable, fast.learnable):
        assert difference(other.blob.diff, one.blob.diff) <= 1e-9, one.label


def test_diffs_stay_unknown_if_the_next_backward_fails_before(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = net_of(PAPER)
    everything(net, batch(3))
    feed(net, batch(3, seed=1))
    assert net.blobs["c1"].data.any()

    monkeypatch.setattr(net.layer_dict["fc"], "backward", interrupt)
    with pytest.raises(KeyboardInterrupt):
        net.backward()
    for name in UNSTORED:
        with pytest.raises(NetlibError, match=f"the diff of blob {name!r} is unknown"):
            net.blobs[name].diff  # noqa: B018


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_diffs_are_unknown_after_numbers_of_items_differ(
    net_of: MakeNet, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, is_interrupted: bool
) -> None:
    """The layers run on the whole batch from then on; the diffs before are not stored."""
    more = CONV % (("cz", "cy") + ("cz",) * 4)
    net = net_of(TWO_SIZES % (OF_X + OF_Y + more), netlib.TRAIN)
    x, y = rng.normal(size=(2, 4, 1, 8, 8))
    net.forward(x=x, y=y, s=np.ones(4))
    net.backward()
    net.forward()
    assert "cy" in unstored(net)
    some = np.array([1, 0, 0, 1])
    if is_interrupted:
        monkeypatch.setattr(SlicedStep, "forward", interrupt)
        with pytest.raises(KeyboardInterrupt):
            net.forward(s=some)
    else:
        net.forward(s=some)
    assert unstored(net) == []
    with pytest.raises(NetlibError, match="the diff of blob 'cy' is unknown"):
        net.blobs["cy"].diff  # noqa: B018


def test_a_part_stores_all_blobs_until_store_all_is_false(net_of: MakeNet) -> None:
    """A call before the part, as by a resumed training, changes nothing."""
    net = net_of(PAPER)
    net.store_all(False)
    feed(net, batch(3))
    assert unstored(net) == UNSTORED
    net.forward(start="c3")
    net.forward()
    assert unstored(net) == [] and net.stores_all
    net.store_all(False)
    assert unstored(net) == [] and not net.stores_all
    net.forward()
    assert unstored(net) == UNSTORED


MOVING = """
    force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 2 dim: 6 dim: 6 } } }
    layer { name: "n" type: "BatchNorm" bottom: "x" top: "n" batch_norm_param { use_global_stats: true }
            param { name: "mean" } param { name: "variance" } param { name: "count" } }
    layer { name: "c" type: "Convolution" bottom: "n" top: "c"
            convolution_param { num_output: 2 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "m" type: "BatchNorm" bottom: "c" top: "m"
            param { name: "mean" } param { name: "variance" } param { name: "count" } }
    layer { name: "l" type: "Reduction" bottom: "m" top: "l" loss_weight: 1 reduction_param { operation: SUMSQ } }
"""


def test_moving_averages_that_another_layer_updates_between_the_passes(net_of: MakeNet) -> None:
    """The backward pass of a solver reads the new ones, as in Caffe."""
    nets = [net_of(MOVING, engine=engine, dtype=np.float64) for engine in ("plain", "fast")]
    for net in nets:
        for param, value in zip(net.params["n"], (0.5, 2, 1)):
            param.data[...] = value
        net.blobs["x"].data[...] = IMAGES["x"]
        net.run_forward_backward()
    assert unstored(nets[1]) == ["n"]
    for name in ("n", "x"):
        plain, fast = (net.blobs[name].diff for net in nets)
        assert difference(fast, plain) <= 1e-9, name


def test_prelu_reads_its_bottom_in_backward(net_of: MakeNet) -> None:
    """After a read, a caller may write the bottom before backward: the gradient is Caffe's."""
    text = """
        force_backward: true
        layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 2 dim: 6 dim: 6 } } }
        layer { name: "p" type: "PReLU" bottom: "x" top: "p" }
        layer { name: "c" type: "Convolution" bottom: "p" top: "c"
                convolution_param { num_output: 2 kernel_size: 1 weight_filler { type: "xavier" } } }
        layer { name: "l" type: "Reduction" bottom: "c" top: "l" loss_weight: 1 }"""
    nets = [net_of(text, engine=engine, dtype=np.float64) for engine in ("plain", "fast")]
    for net in nets:
        net.forward(x=IMAGES["x"])
        net.store_all()
        net.blobs["x"].data[...] = IMAGES["y"]
        net.backward()
    plain, fast = (net.params["p"][0].diff for net in nets)
    assert difference(fast, plain) <= 1e-12
