"""An access to a blob that slices do not store gives its value in the last pass, whatever a caller
has written since.
"""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from fast.slices import SlicedStep
from netlib.errors import NetlibError
from tests.support.nets import inputs
from tests.support.sliced_nets import (
    PAPER,
    UNSTORED,
    Arrays,
    MakeNet,
    assert_close,
    assert_equal,
    batch,
    check_blob,
    difference,
    everything,
    expected_of,
    feed,
    unstored,
)

pytestmark = pytest.mark.usefixtures("slices_of_any_size")


def after_a_pass(net_of: MakeNet) -> tuple[netlib.Net, dict[str, Arrays]]:
    """The paper's network after a pass, and what its blobs hold then."""
    net = net_of(PAPER)
    everything(net, batch(3))
    return net, expected_of(net_of, batch(3))


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


def test_backward_after_an_input_was_written_is_an_error(net_of: MakeNet) -> None:
    net = net_of(PAPER)
    feed(net, batch(3))
    net.blobs["depth"].data.flat[-1] += 1
    with pytest.raises(
        NetlibError, match=r"blob 'depth' was written between forward and backward.* such as 'c1'"
    ):
        net.backward()
    net.forward()
    net.backward()


@pytest.mark.parametrize("written", ["x", "x_x_0_split_1"])
def test_backward_after_an_input_with_other_readers_was_written_is_an_error(
    net_of: MakeNet, written: str
) -> None:
    net = net_of(
        """force_backward: true
        layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 2 dim: 4 } } }
        layer { name: "t" type: "Input" top: "t" input_param { shape { dim: 1 } } }
        layer { name: "s" type: "Scale" bottom: "x" top: "s" }
        layer { name: "r" type: "Reshape" bottom: "x" top: "r" reshape_param { shape { dim: -1 } } }
        """
    )
    net.forward(x=np.ones((3, 2, 4)))
    net.backward()
    net.blobs[written].data[...] = 2
    with pytest.raises(NetlibError, match="written between forward and backward"):
        net.backward()


@pytest.mark.parametrize(
    "of_x",
    [
        'name: "a" type: "Pooling" top: "a" pooling_param { kernel_size: 2 }',
        # in slices it reads a copy of x, alone it reads x
        'name: "a" type: "ReLU" top: "a" } layer { name: "s" type: "Reduction" bottom: "x" top: "s"',
    ],
    ids=["one reader", "another reader"],
)
def test_layers_that_keep_their_shapes_keep_their_values(net_of: MakeNet, of_x: str) -> None:
    """Others of the same slices, whose blobs have another shape, run alone before backward."""
    net = net_of(
        f"""force_backward: true
        layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ dim: 3 dim: 2 dim: 4 dim: 4 }} }} }}
        layer {{ name: "y" type: "Input" top: "y" input_param {{ shape {{ dim: 3 dim: 2 dim: 4 dim: 4 }} }} }}
        layer {{ name: "b" type: "Pooling" bottom: "y" top: "b" pooling_param {{ kernel_size: 2 }} }}
        layer {{ bottom: "x" {of_x} }}
        """
    )
    net.forward(x=np.ones((3, 2, 4, 4)), y=np.ones((3, 2, 4, 4)))
    net.blobs["x"].data[...] = 2
    net.blobs["y"].reshape(1, 2, 4, 4)
    net.reshape()
    net.backward()
    assert (net.blobs["a"].data == 1).all()


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


def test_a_read_after_a_parameter_was_reshaped(net_of: MakeNet) -> None:
    net, expected = after_a_pass(net_of)
    net.params["c1"][0].reshape(8, 25)
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
