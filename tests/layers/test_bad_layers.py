"""Layers that cannot be built or run: options, shapes or values of the bottoms, and the
line of the error.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from netlib.errors import DataError, LayerError, PrototxtError
from tests.layers.conftest import Run
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs
from tests.support.tables import pairs_of, shape_of

INVALID = Path(__file__).parent / "invalid"


def array_of(word: str) -> np.ndarray:
    """Return the values of a list, or zeros of a shape."""
    return np.array(json.loads(word)) if word[0] == "[" else np.zeros(shape_of(word))


def run(layer: str, bottoms: str, tops: str = "1 top") -> Run:
    """Run the layer of a row."""
    kind, _, options = layer.partition(" ")
    arrays = [array_of(word) for word in bottoms.split()]
    return Run(f'type: "{kind}" {options}', arrays, int(tops.split()[0]))


def invalid(table: str) -> Any:
    """Parametrize a test by the rows of a table."""
    rows = pairs_of(INVALID / table)
    at = "<gradcheck>:1:...: error: layer 'it': "
    return bad_inputs(LayerError, {" ".join(given): (given, at + line) for given, line in rows})


@invalid("layers.txt")
def test_invalid_layers_are_rejected(given: Sequence[str], rejected: Any) -> None:
    with rejected:
        run(*given)


@bad_inputs(
    PrototxtError,
    {
        'type: "Clip" clip_param { min: 0 }': "<gradcheck>:1:...: error: missing required field 'max' in clip_param",
        'type: "Tile" tile_param { axis: 1 }': "<gradcheck>:1:36: error: missing required field 'tiles' in tile_param",
        'type: "Reduction" reduction_param { operation: MAX }': (
            "<gradcheck>:1:59: error: unknown value MAX of 'operation'; known values: SUM, ASUM, "
            "SUMSQ, MEAN"
        ),
        'type: "HingeLoss" hinge_loss_param { norm: 0 }':
        # in numbers L1 is 1 and L2 is 2
        "<gradcheck>:1:55: error: unknown value 0 of 'norm'; known values: L1, L2",
        'type: "DetectionOutput"': (
            "<gradcheck>:1:1: error: missing required field 'num_classes' in detection_output_param"
        ),
        "base of Exp": (
            'type: "Exp" exp_param { base: 0 }',
            LayerError,
            "<gradcheck>:1:36: error: layer 'it': base 0 must be positive and finite, or -1 for e",
        ),
        "base of Log": (
            'type: "Log" log_param { base: 0 }',
            LayerError,
            "<gradcheck>:1:36: error: layer 'it': base 0 must be positive, finite and not 1, or -1 for e",
        ),
        "no H": (
            'type: "InfogainLoss" infogain_loss_param { source: "H.binaryproto" }',
            DataError,
            "H.binaryproto: cannot read the blob: No such file...",
        ),
        "MVN in place": (
            'type: "MVN"',
            LayerError,
            "<gradcheck>:1:1: error: layer 'it': bottom 'bottom0' has shape (2, 3), expected ..., in place 4",
        ),
    },
)
def test_invalid_options_are_rejected(given, rejected):
    count = 3 if "Output" in given else 2 if "Loss" in given else 1
    with rejected:
        Run(given, [np.zeros((2, 3))] * count, in_place="MVN" in given)


@invalid("reshapes.txt")
def test_shapes_that_must_stay(given: Sequence[str], rejected: Any) -> None:
    """What the shapes of the parameters depend on may not change after setup;
    nothing is broadcast.
    """
    layer, bottoms, later = given
    done = run(layer, bottoms)
    for blob, shape in zip(done.bottom, later.split()):
        blob.reshape(shape_of(shape))
    with rejected:
        done.layer.reshape(done.bottom, done.top)


@invalid("gradients.txt")
def test_backward_without_a_gradient_is_an_error(given: Sequence[str], rejected: Any) -> None:
    *made, wanted = given if len(given) == 4 else (*given, "")
    done = run(*made)
    computed = [not wanted or str(i) in wanted.split() for i in range(len(done.bottom))]
    with rejected:
        done.backward(*(np.ones(blob.shape) for blob in done.top), wanted=computed)


@bad_inputs(
    LayerError,
    {
        # the sign of x would be lost; Caffe rejects it, too
        "AbsVal": (
            'name: "a" type: "AbsVal" bottom: "x" top: "x"',
            "net.prototxt:2:7: error: layer 'a': AbsVal cannot run in place, but 'x' is both bottom and top",
        ),
        # y does not determine x
        "ReLU": (
            'name: "r" type: "ReLU" bottom: "x" top: "x" relu_param { negative_slope: -1 }',
            "net.prototxt:2:...: error: layer 'r': a negative negative_slope cannot run in place",
        ),
        "ReLU6": (
            'name: "r" type: "ReLU6" bottom: "x" top: "x" relu6_param { negative_slope: -1 }',
            "net.prototxt:2:...: error: layer 'r': a negative negative_slope cannot run in place",
        ),
        "Parameter": (
            'name: "w" type: "Parameter" top: "w" parameter_param { shape { dim: -2 dim: 3 } }',
            "net.prototxt:2:...: error: layer 'w': shape (-2, 3) has a negative size",
        ),
        "lr_mult": (
            'name: "b" bottom: "x" top: "y" type: "BatchNorm" param { lr_mult: 2 }',
            "net.prototxt:2:...: error: layer 'b': param 0 has lr_mult 2, but statistics are not learned: expected 0",
        ),
        "named": (
            'name: "b" bottom: "x" top: "y" type: "BatchNorm" param { name: "m" }',
            "net.prototxt:2:...: error: layer 'b': param 0 has lr_mult 1, but statistics are not learned: expected 0",
        ),
        "bn_param": (
            'name: "b" type: "BatchNorm" bottom: "x" bn_param {}',
            "...error: layer 'b': bn_param "
            'belongs to the type BN; expected batch_norm_param, or type: "BN"',
        ),
    },
)
def test_invalid_nets_are_rejected(net_of, given, rejected):
    """Layers that cannot run in place, statistics with a learning rate, and options of another
    type are an error.
    """
    with rejected:
        net_of(inputs(x=(2, 3)) + f"\nlayer {{ {given} }}")
