"""Texts of nets, and calls of nets, that are refused, and the line of each error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import netlib
from netlib.errors import LayerError, NetlibError, PrototxtError
from netlib.fillers import fill
from netlib.proto import messages, prototxt, wire
from netlib.proto.messages import Filler, LayerParameter
from netlib.proto.wire import WireError
from netlib.system.memory import OutOfMemoryError
from tests.netlib.conftest import MakeNet
from tests.support.bad_input import bad_inputs
from tests.support.nets import ONE, X, inputs, ip, loss, shared

pytestmark = pytest.mark.both_engines


WRITTEN = (
    "is already written by layer {!r}; give it another name, or that of the bottom in the same "
    "place ({}) to run ..."
)
BN = '(the layer BN needs the current format: layer { type: "BN" ... })'


def chain(*params: str) -> str:
    """InnerProduct layers b0, b1 ... that share a parameter, with these options of it."""
    return X + "".join(
        ip(f"b{i}", f"b{i - 1}" if i else "x", f"b{i}", f'param {{ name: "w" {param} }}')
        for i, param in enumerate(params)
    )


def after(shape: str, layer: str) -> str:
    text = f'layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ {shape} }} }} }}'
    return f'{text} layer {{ name: "l" bottom: "x" {layer} }}'


@bad_inputs(
    LayerError,
    {
        name: (text, *error, f"net.prototxt:1:{'' if line[0] == '1' else '...: error: '}{line}")
        for name, text, *error, line in (
            (
                "bottom",
                X + ip("a", "nothing", "a"),
                "layer 'a': unknown bottom blob 'nothing'; known here: x",
            ),
            (
                "bottom misspelt",
                X + ip("a", "xx", "a"),
                "layer 'a': unknown bottom blob 'xx' (did you mean 'x'?)",
            ),
            (
                "top twice",
                ONE + ip("b", "x", "a"),
                f"layer 'b': top blob 'a' {WRITTEN.format('a', 0)}",
            ),
            (
                "top of another bottom",
                X
                + inputs(g=(2, 3))
                + 'layer { name: "s" type: "Scale" bottom: "x" bottom: "g" top: "g" }',
                f"layer 's': top blob 'g' {WRITTEN.format('g', 0)}",
            ),
            (
                "in place",
                X + ip("a", "x", "x"),
                "layer 'a': InnerProduct cannot run in place, but 'x' is both bottom and top",
            ),
            (
                "two bottoms",
                X + ip("a", "x", "a", 'bottom: "x"'),
                "layer 'a': has 2 bottoms, InnerProduct takes 1",
            ),
            (
                "two tops",
                X + ip("a", "x", "a", 'top: "b"'),
                "layer 'a': has 2 tops, InnerProduct takes 1",
            ),
            (
                "no bottom",
                X + 'layer { name: "c" type: "Concat" top: "c" }',
                "layer 'c': has 0 bottoms, Concat takes at least 1",
            ),
            (
                "one bottom",
                X + 'layer { name: "l" type: "EuclideanLoss" bottom: "x" }',
                "layer 'l': has 1 bottoms, EuclideanLoss takes 2",
            ),
            (
                "loss_weight",
                X + ip("a", "x", "a", "loss_weight: 1 loss_weight: 2"),
                "layer 'a': has 1 tops, but 2 loss_weight",
            ),
            (
                "propagate_down",
                X + ip("a", "x", "a", "propagate_down: true propagate_down: true"),
                "layer 'a': has 1 bottoms, but 2 propagate_down",
            ),
            (
                "shapes",
                X + loss("x").replace("dim: 2 dim: 3", "dim: 2 dim: 4"),
                "layer 'loss': bottoms 'x' (2, 3) and 't' "
                "(2, 4) must have the same number of items and of values per item",
            ),
            (
                "shared shapes",
                X
                + ip("a", "x", "a", 'param { name: "w" }', 4)
                + ip("b", "a", "b", 'param { name: "w" }', 3),
                "layer 'b': parameter 0 (3, 4) cannot share 'w' with layer 'a' parameter 0 (4, 3)",
            ),
            (
                "shared lr_mult",
                shared("lr_mult: 3"),
                "layer 'b': shared parameter 'w' has lr_mult 3, but 2 in layer 'a'",
            ),
            (
                "shared decay_mult",
                shared("decay_mult: 0"),
                "layer 'b': shared parameter 'w' has decay_mult 0, but 1 in layer 'a'",
            ),
            (
                "decay_mult of the third",
                chain("lr_mult: 3", "", "decay_mult: 0", "lr_mult: 3 decay_mult: 1"),
                "layer 'b3': shared parameter 'w' has decay_mult 1, but 0 in layer 'b2'",
            ),
            (
                "three params",
                X + ip("a", "x", "a", "param { } param { } param { }"),
                "layer 'a': has 2 parameters, but 3 param blocks",
            ),
            (
                "no classes",
                after("dim: 2 dim: 0", 'type: "Softmax" top: "y"'),
                "layer 'l': bottom 'x' (2, 0) is empty; Softmax expects values",
            ),
            (
                "no channels",
                after(
                    "dim: 2 dim: 0 dim: 4 dim: 4",
                    'type: "Convolution" top: "y" convolution_param { num_output: 3 kernel_size: 3 }',
                ),
                "layer 'l': bottom 'x' (2, 0, 4, 4) has no channels",
            ),
            (
                "two tops of one name",
                after(
                    "dim: 1 dim: 47 dim: 8 dim: 8",
                    'bottom: "x" type: "HandAugment" top: "y" top: "y"',
                ),
                f"layer 'l': top blob 'y' {WRITTEN.format('l', 1)}",
            ),
            (
                "a huge window",
                after(
                    "dim: 1 dim: 1 dim: 8 dim: 8",
                    'type: "Pooling" top: "y" pooling_param '
                    "{ pool: AVE kernel_size: 4294967295 pad: 4294967294 }",
                ),
                OutOfMemoryError,
                "layer 'l': reshape: a blob cannot have the shape (1, 1, 4294967302, "
                "4294967302): no computer has so much "
                "memory; use a smaller batch or layer",
            ),
            (
                "include and exclude",
                X
                + 'layer { name: "p" type: "Power" bottom: "x" top: "p" include { } exclude { } }',
                PrototxtError,
                "layer 'p' has both include and exclude rules",
            ),
            (
                "input without shape",
                'input: "a" input_dim: 1',
                PrototxtError,
                "1: error: 1 input_dim; expected four for all inputs or four per input",
            ),
            (
                "three inputs",
                'input: "a" input: "b" input: "c" input_shape { } input_shape { }',
                PrototxtError,
                "3 inputs, but 2 input_shape; expected one for all or one per input",
            ),
            (
                "type misspelt",
                'layer { name: "a" type: "Convolutoin" }',
                PrototxtError,
                "unknown layer type 'Convolutoin' (did you mean 'Convolution'?); docs/layers.md lists all; ...",
            ),
            ("no type", 'layer { name: "a" }', PrototxtError, "layer 'a' has no type"),
            ("no layers", "", PrototxtError, "this file has no layers; expected a net"),
            (
                "a solver",
                'net: "train_val.prototxt" base_lr: 0.1',
                PrototxtError,
                "1: error: this is a solver; expected a net",
            ),
            (
                "options of another type",
                'layer { name: "x" type: "Power" power_parm { } }',
                PrototxtError,
                "unknown field 'power_parm'; known fields: name, type, ...",
            ),
            (
                "option misspelt",
                'layer { name: "x" type: "Power" bottom: "x" top: "y" power_param { scael: 2 } }',
                PrototxtError,
                "unknown field 'scael' (did you mean 'scale'?)",
            ),
            (
                "BN in V1",
                'layers { name: "b" type: BN bn_param { } }',
                PrototxtError,
                f"unknown value BN of 'type' {BN}",
            ),
            (
                "options of a fork",
                inputs(x=(1,))
                + 'layer { name: "r" type: "ReLU" bottom: "x" top: "y" quantization_param '
                "{ bw_layer_in: 8 } }",
                PrototxtError,
                "unknown option 'quantization_param' of a fork of Caffe changes the "
                "result; not supported",
            ),
            (
                "Python without its options",
                X + 'layer { name: "p" type: "Python" bottom: "x" top: "y" }',
                PrototxtError,
                "layer 'p' of type 'Python' needs a python_param",
            ),
        )
    },
)
def test_invalid_nets_are_rejected(net_of: MakeNet, given: str, rejected: Any) -> None:
    with rejected:
        net_of(given).forward()


VALUE = "got a masked array; expected a plain one, for example array.filled(VALUE)"
MASKED = np.ma.masked_equal(np.ones((2, 3)), 0)


@bad_inputs(
    NetlibError,
    {
        "input": (lambda net: net.forward(y=np.ones(3)), "net '' has no input 'y'; its inputs: x"),
        "shape": (
            lambda net: net.forward(x=np.ones(3)),
            LayerError,
            "input 'x' has shape (2, 3), got an array of shape (3,)",
        ),
        "start": (
            lambda net: net.forward(start="aa"),
            "net '' has no layer 'aa' (did you mean 'a'?)",
        ),
        "blob": (lambda net: net.forward(["aaa"]), "net '' has no blob 'aaa'"),
        "masked": (lambda net: net.forward(x=MASKED), LayerError, f"input 'x' {VALUE}"),
        "texts": (
            lambda net: net.forward(x=np.full((2, 3), "a")),
            LayerError,
            "input 'x' got an array of <U1; expected numbers",
        ),
        "lengths": (
            lambda net: net.forward(x=[[1, 2], [3]]),
            LayerError,
            "input 'x' got rows of different lengths; expected one array",
        ),
        "features": (
            lambda net: net.forward(x=np.ones((2, 4))),
            LayerError,
            "net.prototxt:1:90: error: layer 'a': bottom 'x' has 4 features (4,), its weights expect 3",
        ),
        "output": (lambda net: net.backward(bb=np.ones(3)), "net '' has no blob 'bb'"),
        "output's shape": (
            lambda net: net.backward(a=np.ones(7)),
            LayerError,
            "output 'a' has shape (2, 3), got an array of shape (7,)",
        ),
        "masked output": (lambda net: net.backward(a=MASKED), LayerError, f"output 'a' {VALUE}"),
        "name": (
            lambda net: net.save(""),
            netlib.WeightsError,
            "...cannot write the snapshot: ...",
        ),
    },
)
def test_invalid_calls_are_rejected(
    net_of: MakeNet, given: Callable[[netlib.Net], object], rejected: Any
) -> None:
    with rejected:
        given(net_of(ONE))


@bad_inputs(
    NetlibError,
    {
        **{
            f"phase {phase}": (
                {"phase": phase},
                f"phase {phase} is unknown; expected 0 (TRAIN) or 1 (TEST)",
            )
            for phase in (-1, 2)
        },
        "int32": ({"dtype": np.int32}, "a net computes in float32 or float64, not in int32"),
    },
)
def test_invalid_arguments_are_rejected(
    net_of: MakeNet, given: dict[str, object], rejected: Any
) -> None:
    with rejected:
        net_of(X, **given)


def filled(shape: tuple[int, ...], *arguments: Any, **options: Any) -> Callable[[], object]:
    return lambda: fill(np.empty(shape), Filler(*arguments, **options), np.random.default_rng(0))


@bad_inputs(
    PrototxtError,
    {
        "sparse": (
            filled((), "gaussian", sparse=1),
            "<built in code>:1:1: error: filler 'gaussian': sparse needs weights with an output axis, found ...",
        ),
        "filler": (
            filled((2, 3), "q"),
            "<built in code>:1:1: error: unknown filler type 'q'; known types: constant, uniform, ...",
        ),
        "field": (
            lambda: wire.encode(prototxt.parse("nam: 1"), LayerParameter),
            "<text>:1:1: error: unknown field 'nam' (did you mean 'name'?)",
        ),
        **{
            f"label {found}": (
                lambda data=data: wire.decode(data, messages.Datum, "x"),
                WireError,
                f"x: byte 1: 'label' expects an integer from -2147483648 to 2147483647, found {found}",
            )
            for data, found in (
                (b"\x28\x80\x80\x80\x80\x10", 4294967296),
                (b"\x28\xff\xff\xff\xff\xf7" + b"\xff" * 4 + b"\x01", -2147483649),
            )
        },
    },
)
def test_invalid_messages_and_fillers_are_rejected(
    given: Callable[[], object], rejected: Any
) -> None:
    with rejected:
        given()
