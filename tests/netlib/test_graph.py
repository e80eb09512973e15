"""Graph: how blobs connect layers, where gradients flow, which tops are losses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import netlib
from tests.netlib.conftest import MakeNet
from tests.support.nets import ONE, X, ip, loss

pytestmark = pytest.mark.both_engines


def backwards(net: netlib.Net) -> dict[str, list[bool]]:
    """Return the layers that run backwards, with propagate_down for each bottom."""
    return {at.layer.name: at.propagate_down for at in net.connections if at.needs_backward}


def test_a_blob_with_two_readers_sums_their_gradients(
    net_of: MakeNet, rng: np.random.Generator
) -> None:
    """A Split layer sums the gradients, as in Caffe; a loss weight on the blob counts as
    one more reader.
    """
    text = (
        "force_backward: true "
        + X
        + ip("a", "x", "a", "loss_weight: 2")
        + ip("b", "a", "b")
        + ip("c", "a", "c")
    )
    net = net_of(text)
    net.forward(x=np.ones((2, 3)))
    db, dc = rng.normal(size=(2, 2, 3)).astype(np.float32)
    net.backward(b=db, c=dc)
    b, c = (net.params[name][0].data for name in "bc")
    want = db @ b + dc @ c + 2
    assert np.allclose(net.blobs["a"].diff, want, rtol=1e-5)
    assert "a_a_0_split" in net.layer_dict


def test_layers_in_place_run_in_file_order(net_of: MakeNet) -> None:
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
    wanted = np.where(x < 0, -2 * (1 - y**2), 0)
    assert np.allclose(net.blobs["x"].diff, wanted, atol=1e-6)


def test_gradients_flow_only_where_something_learns_below_a_loss(net_of: MakeNet) -> None:
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
    """force_backward computes gradients down to the inputs, but not for labels."""
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
    net = net_of(ONE + ip("b", "a", "b", "propagate_down: false") + loss("b"))
    assert backwards(net) == {"b": [False], "loss": [True, False]}


def test_propagate_down_true_asks_for_a_gradient(net_of: MakeNet) -> None:
    net = net_of(X + ip("a", "x", "a", "propagate_down: true") + loss("a"))
    net.forward(x=np.ones((2, 3)))
    net.backward()
    assert net.blobs["x"].diff.any()


@pytest.mark.parametrize(
    ("weight", "layer"),
    [(3, "loss_weight: 3"), (1, ""), (0.5, "loss_weight: 0.5"), (-1, "loss_weight: -1")],
)
def test_loss_weight(net_of: MakeNet, weight: float, layer: str) -> None:
    """The top holds the unweighted loss; the net's loss and the gradients are weighted."""
    net = net_of(ONE + loss("a", layer))
    net.params["a"][0].data[...] = np.eye(3)
    total = None
    net.forward(x=np.ones((2, 3)), t=np.zeros((2, 3)))
    total = net.loss()
    net.backward()
    assert float(net.blobs["loss"].data) == pytest.approx(1.5)
    assert total == pytest.approx(1.5 * weight)
    assert np.allclose(net.blobs["a"].diff, weight / 2)


def test_the_weight_of_a_loss_of_another_shape_is_set_after_forward(net_of: MakeNet) -> None:
    net = net_of(X + ip("a", "x", "a", "loss_weight: 0.5"))
    net.blobs["x"].reshape(4, 3)
    net.forward()
    assert (net.blobs["a"].diff == 0.5).all()


def test_loss_weight_on_an_ordinary_top(net_of: MakeNet) -> None:
    """The loss is the weighted sum of the top's values and its gradient is the weight; 0
    disables a loss layer.
    """
    net = net_of(X + ip("a", "x", "a", "loss_weight: 0.5"))
    net.forward(x=np.ones((2, 3)))
    net.backward()
    assert net.loss() == pytest.approx(0.5 * net.blobs["a"].data.sum(), rel=1e-5)
    assert np.allclose(net.params["a"][1].diff, 2 * 0.5)
    assert not backwards(net_of(ONE + loss("a", "loss_weight: 0")))


def test_a_loss_may_go_without_a_top(net_of: MakeNet) -> None:
    """A loss without a top is named "(automatic)" as in Caffe; it contributes to the loss and is
    not an output.
    """
    net = net_of(ONE + 'layer { name: "l" type: "EuclideanLoss" bottom: "a" bottom: "x" }')
    named = net_of(
        ONE + 'layer { name: "l" type: "EuclideanLoss" bottom: "a" bottom: "x" top: "l" }'
    )
    for one in (net, named):
        one.blobs["x"].data[...] = 1
        one.params["a"][0].data[...] = 2
        one.run_forward()
        one.run_backward()
    assert net.loss() == named.loss() > 0
    assert np.array_equal(net.params["a"][0].diff, named.params["a"][0].diff)
    assert (net.outputs, named.outputs) == ([], ["l"])
    assert [name for _, _, name in net.losses] == ["(automatic)"]


POWER = '"Power" power_param { scale: 3 }'
VALUES = "layer 'p0' overwrites blob 's', which the gradient of layer 'r' needs: it will be wrong"
SIGNS = "overwrites blob 'a', of which the gradient of layer 'r' needs the signs"


@pytest.mark.parametrize(
    ("below", "top", "behind", "warning"),
    [
        ("Sigmoid", "s", [POWER], VALUES),
        ("TanH", "s", [POWER], VALUES),
        ("ReLU", "s", [POWER], ""),
        ("BNLL", "s", [POWER], ""),
        ("ReLU", "a", ['"Power" power_param { shift: -0.5 }'], SIGNS),
        ("ReLU", "a", ['"Scale" scale_param { filler { value: -1 } }'], SIGNS),
        ("ReLU", "a", ['"Dropout"'], ""),
        ("ReLU", "a", ['"ReLU"', '"Dropout"'], ""),
        ("ReLU", "a", ['"Dropout"', '"BatchNorm"'], SIGNS),
    ],
    ids=str,
)
def test_layers_in_place_that_spoil_a_gradient_give_a_warning(
    net_of: MakeNet,
    caplog: pytest.LogCaptureFixture,
    below: str,
    top: str,
    behind: list[str],
    warning: str,
) -> None:
    """The layer overwrites a top needed by another gradient. Caffe gives no warning."""
    text = ONE + f'layer {{ name: "r" type: "{below}" bottom: "a" top: "{top}" }} '
    for i, kind in enumerate(behind):
        text += f'layer {{ name: "p{i}" bottom: "{top}" top: "{top}" type: {kind} }} '
    net_of(text)  # without a loss nothing runs backwards, so there is no warning
    assert caplog.messages == []
    net_of(
        text + f'layer {{ name: "l" type: "EuclideanLoss" bottom: "{top}" bottom: "x" top: "l" }}'
    )
    assert len(caplog.messages) == bool(warning)
    assert warning in caplog.text


def test_two_layers_of_one_name(
    net_of: MakeNet, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Both layers run, as in Caffe; the second gets a new name, so that both keep their weights."""
    text = ONE + 'layer { name: "r" type: "ReLU" bottom: "a" top: "a" } ' + ip("a", "a", "b")
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
