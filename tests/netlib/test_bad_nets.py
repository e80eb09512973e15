"""Texts of nets, and calls of nets, that are refused, and the line of each error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
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
from tests.support.nets import ONE, X
from tests.support.tables import pairs_of

pytestmark = pytest.mark.both_engines


ERRORS = {error.__name__: error for error in (LayerError, OutOfMemoryError, PrototxtError)}
NETS = {
    line: (text.replace("X ", X), ERRORS[error], f"net.prototxt:1:{line}")
    for (error, text), line in pairs_of(Path(__file__).with_name("invalid_nets.txt"))
}


@bad_inputs(LayerError, NETS)
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
        "one name": (
            lambda net: net.forward("a"),
            "expected a list of names of blobs to return, found a str; "
            "arrays are given by name, as in forward(data=images)",
        ),
        # as in other libraries; it would run on the old input
        "array without a name": (
            lambda net: net.forward(np.ones((2, 3))),
            "expected a list of names of blobs to return, found a ndarray; arrays are given by name, "
            "as in forward(data=images)",
        ),
        "dictionary": (lambda net: net.forward({"x": np.ones((2, 3))}), "...found a dict; ..."),
        "diff": (lambda net: net.backward({"a": np.ones((2, 3))}), "...found a dict; ..."),
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
        # as by Net(file, TEST, "net.caffemodel") in pycaffe
        "weights as level": (
            {"level": "net.caffemodel"},
            "level 'net.caffemodel', stages None: expected a number and a list of names; pass a file "
            "of weights as weights=",
        ),
        "a text as stages": ({"stages": "deploy"}, "level 0, stages 'deploy': expected ..."),
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
