"""A layer that computes those behind it does not store the blobs between them; each has the values
of the last pass at any moment, whatever a caller has written since.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

import numpy as np
import pytest

import netlib
from fast.slices import SlicedStep
from fast.whole_steps import FusedStep, whole_steps
from netlib.errors import NetlibError
from netlib.proto import prototxt
from tests.support.nets import inputs
from tests.support.sliced_nets import unstored

Net = netlib.Net
# as the author of MobileNet v2 wrote his net: BatchNorm writes a blob of its own
NET = """
layer { name: "conv1" type: "Convolution" bottom: "x" top: "conv1"
    convolution_param { num_output: 8 kernel_size: 3 pad: 1 } }
layer { name: "bn1" type: "BatchNorm" bottom: "conv1" top: "bn1" }
layer { name: "scale1" type: "Scale" bottom: "bn1" top: "bn1" scale_param { bias_term: true } }
layer { name: "relu1" type: "ReLU" bottom: "bn1" top: "relu1" }
layer { name: "conv2" type: "Convolution" bottom: "relu1" top: "conv2"
    convolution_param { num_output: 8 kernel_size: 1 } }
layer { name: "bn2" type: "BatchNorm" bottom: "conv2" top: "bn2" }
layer { name: "sum" type: "Eltwise" bottom: "relu1" bottom: "bn2" top: "sum" }
layer { name: "norm" type: "BatchNorm" bottom: "sum" top: "norm" }
layer { name: "relu3" type: "ReLU" bottom: "norm" top: "y" }
"""
BETWEEN = ["conv1", "bn1", "conv2", "norm"]


def make(engine: str, items: int) -> Net:
    """The net, with random weights of which no array is in use."""
    text = inputs(x=(items, 3, 6, 7)) + NET
    net = Net(prototxt.parse(text), netlib.TEST, engine=engine, seed=3)
    rng = np.random.default_rng(5)
    for param in net.learnable:
        param.blob.data[...] = rng.uniform(0.5, 1.5, param.blob.shape)
    return net


def run(net: Net, seed: int = 7) -> None:
    x = np.random.default_rng(seed).normal(size=net.blobs["x"].shape)
    net.forward(x=x.astype(np.float32))


@pytest.mark.parametrize("items", [1, 3])
def test_blobs_between_the_layers_are_unstored(items: int) -> None:
    net = make("fast", items)
    run(net)
    assert set(BETWEEN) <= set(unstored(net))
    assert all(not net.blobs[name]._memory.arrays for name in BETWEEN)


def test_a_blob_with_another_reader_is_stored() -> None:
    text = inputs(x=(1, 3, 6, 7)) + NET
    text += 'layer { name: "twice" type: "Power" bottom: "conv1" top: "twice" }'
    net = Net(prototxt.parse(text), netlib.TEST, engine="fast")
    run(net)
    assert "conv1" not in unstored(net) and "conv2" in unstored(net)


def test_blobs_are_stored_if_there_is_a_backward_pass() -> None:
    net = Net(
        prototxt.parse("force_backward: true " + inputs(x=(1, 3, 6, 7)) + NET),
        netlib.TEST,
        engine="fast",
    )
    run(net)
    assert not unstored(net)


def write_held(
    name: str, index: int | None = None, then: Callable[[Net], object] = lambda net: None
) -> Callable[[Net], Callable[[], None]]:
    """A caller that has an array from before the pass, and writes it after the pass."""

    def begin(net: Net) -> Callable[[], None]:
        blob = net.blobs[name] if index is None else net.params[name][index]
        array = blob.data

        def end() -> None:
            array[...] = 5
            then(net)

        return end

    return begin


def after(change: Callable[[Net], object]) -> Callable[[Net], Callable[[], None]]:
    """A caller that changes something after the pass."""
    return lambda net: lambda: change(net) and None


def fill(name: str, index: int | None = None) -> Callable[[Net], Callable[[], None]]:
    def change(net: Net) -> None:
        blob = net.blobs[name] if index is None else net.params[name][index]
        blob.data[...] = 5

    return after(change)


WRITES = {
    "nothing": after(lambda net: None),
    "an array of the input": write_held("x"),
    "an array of weights": write_held("conv1", 0),
    "an array of a bias": write_held("conv2", 1),
    "an array between": write_held("relu1"),
    "an array of the input, backward": write_held("x", then=Net.backward),
    "an array of statistics": write_held("bn1", 0),
    "the input": fill("x"),
    "weights": fill("conv1", 0),
    "a gain": fill("scale1", 0),
    "a blob between": fill("relu1"),
    "weights of another net": after(lambda net: net.copy_from(make("plain", 1))),
    "shared weights": after(lambda net: net.params["conv1"][0].share(netlib.Blob((8, 3, 3, 3)))),
    "the shape of the input": after(lambda net: net.blobs["x"].reshape(2, 3, 6, 7)),
    "a second pass": after(lambda net: run(net, 11)),
    "the input twice": after(lambda net: [net.blobs["x"].data.fill(value) for value in (5, 6)]),
    "a part": after(lambda net: net.forward(start="bn2")),
}


@pytest.mark.parametrize("items", [1, 3])
@pytest.mark.parametrize("name", BETWEEN)
@pytest.mark.parametrize("what", WRITES)
def test_a_blob_has_the_values_of_the_pass(what: str, name: str, items: int) -> None:
    found: dict[str, list[np.ndarray]] = {}
    for engine in ("plain", "fast"):
        net = make(engine, items)
        run(net, 1)
        for _ in range(2):  # the second time, all blobs are stored
            end = WRITES[what](net)
            run(net)
            end()
            values = net.blobs[name].data.copy()
            found.setdefault(engine, []).append(values)
    for plain, fast in zip(found["plain"], found["fast"]):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-5 * np.abs(plain).max())


def test_an_access_to_a_source_keeps_the_net_lean() -> None:
    net = make("fast", 1)
    for turn in range(3):
        net.blobs["x"].data[...] = turn + 1
        net.forward()
        assert net.blobs["relu1"].data.any() and net.params["conv1"][0].data.any()
    assert set(BETWEEN) <= set(unstored(net))


def test_only_sources_in_use_are_copied_in_a_pass() -> None:
    net = make("fast", 1)
    held = net.params["conv1"][0].data
    run(net)
    steps = [step for step in net.steps if isinstance(step, FusedStep)]
    copied = [blob for step in steps for blob in step.reading.copies]
    assert copied == [net.params["conv1"][0]]
    del held
    run(net)
    assert not any(step.reading.copies for step in steps)


def test_a_step_has_the_layers_that_it_computes() -> None:
    net = make("fast", 1)
    steps = whole_steps(net.connections, set())
    kinds = [[at.layer.name for at in step.connections] for step in steps]
    assert ["conv1", "bn1", "scale1", "relu1"] in kinds and ["norm", "relu3"] in kinds


def test_a_pass_that_ends_early_leaves_no_mixed_values() -> None:
    """The second pass has new values of ``relu1``, of which ``conv2`` is not computed any more.
    Looks are errors, also where the layers could compute the values again.
    """
    net = make("fast", 1)
    run(net)
    layer = net.layer_dict["conv2"]
    forward, layer.forward = layer.forward, None  # type: ignore[method-assign, assignment]
    with pytest.raises(NetlibError, match="forward failed"):
        run(net, 8)
    layer.forward = forward  # type: ignore[method-assign]
    for name in ("conv2", "norm"):
        with pytest.raises(NetlibError, match=f"'{name}' is unknown"):
            net.blobs[name].data  # noqa: B018


def test_the_same_of_layers_that_no_longer_run_in_slices() -> None:
    net = make("fast", 3)
    (sliced,) = [step for step in net.steps if isinstance(step, SlicedStep)]
    sliced._run_whole()
    run(net)
    fused = [step for step in sliced._whole if isinstance(step, FusedStep)]
    assert fused and all(step.reading.is_done for step in fused)
    sliced.begin()
    missing = sliced.store().halves
    assert set(missing) == {blob for step in fused for blob in step.unstored}


def test_blobs_that_share_memory_with_a_source_do_not_change_others() -> None:
    found = []
    for engine in ("plain", "fast"):
        net = make(engine, 1)
        run(net)
        net.blobs["y"].share(net.blobs["relu1"])
        run(net, 8)
        found.append({name: net.blobs[name].data.copy() for name in ("conv1", "conv2")})
    for name, expected in found[0].items():
        np.testing.assert_allclose(found[1][name], expected, rtol=0, atol=1e-5 * expected.max())


def test_a_net_that_shares_parameters_of_another_runs_without_it() -> None:
    one, other = make("fast", 1), make("fast", 1)
    run(one)
    other.share_params(one)
    del one
    gc.collect()
    run(other)
    assert "conv1" not in unstored(other)  # other nets may write what is shared
