"""prototxt/: the nets of the project fit together."""

from __future__ import annotations

from pathlib import Path

import pytest
from pytest import approx

from netlib.proto.messages import NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.schema import Phase
from netlib.training import solver_parameter

pytestmark = pytest.mark.both_engines

PROTOTXT = Path(__file__).resolve().parents[1] / "prototxt"
LEARNED = {
    "Convolution": "convolution_param",
    "Deconvolution": "convolution_param",
    "InnerProduct": "inner_product_param",
}


def learned(net: str, phase: Phase) -> dict[str, str]:
    """Return the number of outputs of the layers with weights, by name."""
    layers = select_layers(load_parameter(PROTOTXT / net), NetState(phase))
    return {
        layer.name: str(layer.blocks[LEARNED[layer.type]].values("num_output")[0])
        for layer in layers
        if layer.type in LEARNED
    }


@pytest.mark.parametrize("net", ["nyu_train_test.prototxt", "synthetic_train_test.prototxt"])
def test_weights_fit_the_net_that_predicts(net: str) -> None:
    """Testing and prediction need the same weights, and training makes all of them."""
    wanted = learned("nyu_deploy.prototxt", "TEST")
    assert len(wanted) == 6
    assert learned(net, "TEST") == wanted
    assert wanted.items() <= learned(net, "TRAIN").items()


def test_the_finder_that_is_trained_is_the_one_that_looks() -> None:
    """The packaged net has the same layers with weights as its training net."""
    wanted = learned("../models/hand_finder/deploy.prototxt", "TEST")
    assert len(wanted) == 21
    assert (
        learned("finder_train_test.prototxt", "TEST")
        == learned("finder_train_test.prototxt", "TRAIN")
        == wanted
    )


PAPER = """
convL1 Convolution num_output: 8 kernel_size: 5 weight_filler { type: "xavier" }
poolL1 Pooling pool: MAX kernel_size: 4 stride: 4
convL2 Convolution num_output: 8 kernel_size: 5 weight_filler { type: "xavier" }
poolL2 Pooling pool: MAX kernel_size: 2 stride: 2
convL3 Convolution num_output: 8 kernel_size: 3 weight_filler { type: "xavier" }
FC1 InnerProduct num_output: 1024 weight_filler { type: "xavier" }
DropoutFC1 Dropout dropout_ratio: 0.3
FC2 InnerProduct num_output: 1024 weight_filler { type: "gaussian" std: 0.001 }
DropoutFC2 Dropout dropout_ratio: 0.3
DoF InnerProduct num_output: 47 weight_filler { type: "gaussian" std: 0.001 }
HandModel HandModel
joint_loss EuclideanLoss
limit_loss PhysLimit norm: L1
"""


def test_the_papers_network_has_the_sizes_that_were_released() -> None:
    """The layers have the released sizes, with a ReLU after each layer with weights
    except the last.
    """
    layers = select_layers(load_parameter(PROTOTXT / "nyu_train_test.prototxt"), NetState("TRAIN"))[
        1:
    ]
    described = [
        " ".join([x.name, x.type, *" ".join(map(str, x.blocks.values())).split()]) for x in layers
    ]
    assert [line for line in described if " ReLU" not in line] == PAPER.split("\n")[1:-1]
    learning = [layer.name for layer in layers if layer.type in LEARNED]
    rectified = [(layer.bottom, layer.top) for layer in layers if layer.type == "ReLU"]
    assert rectified == [((name,), (name,)) for name in learning[:-1]]


def test_the_papers_losses() -> None:
    """The losses are the distance of all 31 joints and the limits of HandModel's input,
    with lambda 1.
    """
    layers = {x.name: x for x in load_parameter(PROTOTXT / "nyu_train_test.prototxt").layer}
    hand, joints, limits = (layers[name] for name in ("HandModel", "joint_loss", "limit_loss"))
    assert joints.bottom == (hand.top[0], "joint")
    assert limits.bottom == hand.bottom == layers["DoF"].top
    assert joints.loss_weight == limits.loss_weight == (1.0,)


@pytest.mark.parametrize("name", ["nyu", "icvl"])
def test_the_papers_training(name: str) -> None:
    """SGD, learning rate 0.003, lowered at most at the end, momentum 0.9, no weight decay,
    batches of 512.
    """
    solver = solver_parameter.read(PROTOTXT / f"{name}_solver.prototxt")
    assert (solver_parameter.type_of(solver), solver.base_lr, solver.momentum) == (
        "SGD",
        approx(0.003),
        approx(0.9),
    )
    assert solver.weight_decay == 0 and solver.iter_size == 1
    assert solver.lr_policy == "fixed" or (solver.stepvalue, solver.gamma) == (
        (solver.max_iter * 9 // 10,),
        approx(0.1),
    )
    data = select_layers(
        load_parameter(PROTOTXT / f"{name}_train_test.prototxt"), NetState("TRAIN")
    )[0]
    assert [str(size) for size in data.blocks["hdf5_data_param"].values("batch_size")] == ["512"]
