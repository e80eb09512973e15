"""Running slice by slice gives the same values in all blobs as layer by layer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from fast import division
from fast.slices import SlicedStep
from tests.support.nets import inputs
from tests.support.sliced_nets import (
    OF_X,
    OF_Y,
    PAPER,
    TWO_SIZES,
    UNSTORED,
    assert_close,
    assert_equal,
    batch,
    difference,
    everything,
    feed,
    layer_by_layer,
    unstored,
)

Agree = MakeNet = Callable[..., netlib.Net]
pytestmark = pytest.mark.usefixtures("slices_of_any_size")


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
    monkeypatch.setattr(division, "MAX_SLICE", 4)
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
    net_of: MakeNet, rng: np.random.Generator, background: str
) -> None:
    inputs = batch(4)
    depth = inputs["depth"]
    if background == "none":
        depth[...] = rng.normal(size=depth.shape)
    elif background == "another value":
        depth[...] = 0.3 * depth - 2
    else:
        depth[...] = 0 if "zero" in background else 1
    expected = everything(layer_by_layer(net_of(PAPER)), inputs)
    assert_close(everything(net_of(PAPER), inputs), expected, 2e-5)


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


def test_relu_after_max_pooling_is_relu_before_it(agree: Agree, rng: np.random.Generator) -> None:
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
    x = rng.integers(-2, 2, (3, 2, 6, 6))
    net = agree(text, {"x": x}, tolerance=1e-6, dtype=np.float32, prepare=whole_numbers)
    step = next(step for step in net.steps if isinstance(step, SlicedStep))
    assert [at.layer.name for at in step.run.order] == ["c", "p", "r", "d"]


def test_a_relu_that_changed_places_leaves_the_diff_of_a_pooled_output_alone(
    net_of: MakeNet, rng: np.random.Generator
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
    dy = rng.normal(size=(3, 2, 3, 3)).astype(np.float32)
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


def test_no_relu_changes_places_with_a_max_pooling_that_has_empty_windows(
    net_of: MakeNet, rng: np.random.Generator
) -> None:
    """A ReLU before the pooling does not change the value of an empty window, minus
    infinity, to 0.
    """
    text = (ODD % 'type: "ReLU"').replace("kernel_size: 3 stride: 3", "kernel_size: 1 stride: 4")
    text += """layer { name: "d" type: "Convolution" bottom: "p" top: "d"
                       convolution_param { num_output: 1 kernel_size: 1 } }"""
    x = rng.normal(size=(3, 1, 9, 8))
    for net in (net_of(text), layer_by_layer(net_of(text))):
        net.params["d"][0].data[...] = 1
        is_empty = np.isneginf(net.forward(x=x)["d"])
        assert is_empty.tolist() == [[[[False, False, True]] * 2 + [[True] * 3]]] * 3


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
    for net in (fast, plain):  # also of a part
        net.forward(start="d")
        shares = [np.shares_memory(net.blobs["a"].data, net.blobs[name].data) for name in "bc"]
        assert shares == [not overwritten, True]
    np.testing.assert_array_equal(fast.blobs["c"].data, plain.blobs["c"].data)


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
