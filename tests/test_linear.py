"""The work grows linearly with the input, counted in function calls instead of seconds."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import netlib
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib import engine
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import upgraded
from tests.support.nets import inputs
from tools.plot_log import LOSS, read_log

SIZE = 40  # of the smaller input
INPUT = inputs(x=(1, 1, 4, 4))
SHARED = 'param { name: "w" } inner_product_param { num_output: 1 bias_term: false }'
CONVOLUTION = "convolution_param { num_output: 1 kernel_size: 1 }"


def calls(work: Callable[[], object]) -> int:
    """Return the number of function calls, in Python and C."""
    count = 0

    def note(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count


def assert_linear(work_on: Callable[[int], Callable[[], object]]) -> None:
    """Assert that four times the input costs at most 4.4 times the calls, not counting work of the
    first run only.
    """
    work_on(2)()
    small, large = calls(work_on(SIZE)), calls(work_on(4 * SIZE))
    assert large <= 4.4 * small, (small, large)


def encoded(text: str) -> bytes:
    """Return a net in binary."""
    return wire.encode(prototxt.parse(text), NetParameter)


def layer(i: int, bottom: str, top: str, kind: str = "ReLU", more: str = "") -> str:
    """Return the text of one layer."""
    return f'layer {{ name: "l{i}" type: "{kind}" bottom: "{bottom}" top: "{top}" {more} }}\n'


NETS: dict[str, Callable[[int], str]] = {
    "in place": lambda n: "".join(layer(i, "x", "x") for i in range(n)),
    "in place, behind one that runs in slices": lambda n: (
        layer(-1, "x", "c", "Convolution", CONVOLUTION)
        + "".join(layer(i, "c", "c", "Sigmoid") for i in range(n))
    ),
    "in a row": lambda n: "".join(
        layer(i, f"c{i}" if i else "x", f"c{i + 1}", "Convolution", CONVOLUTION) for i in range(n)
    ),
    "readers of one blob": lambda n: "".join(layer(i, "x", f"r{i}") for i in range(n)),
    "whole ones": lambda n: "".join(
        layer(i, "x", f"r{i}", "InnerProduct", "inner_product_param { num_output: 1 }")
        for i in range(n)
    ),
    "parameters of one name": lambda n: "".join(
        layer(i, "x", f"r{i}", "InnerProduct", SHARED) for i in range(n)
    ),
    "layers of one name": lambda n: "".join(layer(0, "x", "x") for i in range(n)),
    "tops of one layer": lambda n: layer(
        0, "x", "t", "Split", "".join(f'top: "t{i}" ' for i in range(n))
    ),
    "bottoms of one layer": lambda n: layer(0, "x", "t", "Concat", 'bottom: "x" ' * n),
    "layers that are left out": lambda n: "".join(
        layer(i, "x", "x", more='include { stage: "a" } include { phase: TEST }') for i in range(n)
    ),
}


@pytest.mark.parametrize("name", engine.NAMES if engine.has_fast() else ["plain"])
@pytest.mark.parametrize("kind", NETS)
def test_building_a_net(kind: str, name: str) -> None:
    """Building nets with many layers, or a layer with many blobs, and running them
    forward is linear.
    """

    def work_on(n: int) -> Callable[[], object]:
        tree = prototxt.parse(INPUT + NETS[kind](n))
        return lambda: netlib.Net(tree, netlib.TRAIN, engine=name).run_forward()

    assert_linear(work_on)


@pytest.mark.parametrize(
    "text",
    [
        'name: "a" ',
        'layer { name: "a" bottom: "b" relu_param { } } ',
        "input_shape { dim: 1 } ",
        "input_dim: [3, 3] ",
        'state { stage: "a" } ',
    ],
)
def test_text_and_bytes(text: str) -> None:
    """Parsing, reading, printing, and writing and reading binary nets is linear."""
    assert_linear(lambda n: partial(prototxt.parse, text * n))
    assert_linear(lambda n: prototxt.parse(text * n).__str__)
    if "name" not in text.split()[0]:
        assert_linear(lambda n: partial(schema.read, prototxt.parse(text * n), NetParameter))
    assert_linear(lambda n: partial(wire.encode, prototxt.parse(text * n), NetParameter))
    assert_linear(lambda n: partial(wire.decode, encoded(text * n), NetParameter))


def test_older_nets() -> None:
    """Upgrading the older format of nets is linear."""
    text = 'layers { name: "a" type: RELU bottom: "x" top: "x" } '
    assert_linear(lambda n: partial(upgraded, prototxt.parse(text * n)))


def test_weights_by_name() -> None:
    """Copying weights by name from one net to another is linear."""

    def work_on(n: int) -> Callable[[], object]:
        one, other = (
            netlib.Net(prototxt.parse(INPUT + NETS["whole ones"](n)), engine="plain")
            for _ in range(2)
        )
        return lambda: one.copy_from(other)

    assert_linear(work_on)


@pytest.mark.parametrize("parent", ["joint {i}", "root"])
def test_a_skeleton(parent: str) -> None:
    """Building a skeleton is linear, whether it is a chain or all joints have one parent."""

    def work_on(n: int) -> Callable[[], object]:
        joints = "".join(
            f'joint {{ name: "joint {i + 1}" parent: "{parent.format(i=i) if i else "root"}" '
            f'rotate {{ axis: X dof: "d{i}" }} }}'
            for i in range(n)
        )
        text = (
            'joint { name: "root" } '
            + "".join(f'dof {{ name: "d{i}" }} ' for i in range(n))
            + joints
        )
        param = schema.read(prototxt.parse(text), SkeletonParameter)
        return lambda: Skeleton(param)

    assert_linear(work_on)


# The following work is a single C call, which takes either a moment or minutes.


def test_long_texts() -> None:
    """Many adjacent strings, and unfinished numbers and strings, are read quickly."""
    [field] = prototxt.parse(
        "name: " + '"' + "a" * 100 + '" ' * 1 + ('"' + "a" * 100 + '" ') * 40_000
    ).fields
    assert len(str(field.value)) == 100 * 40_001 + 2
    for text in ("1" * 80_000 + "x", "-" + " " * 80_000 + "x", '"' + '\\"' * 80_000):
        with pytest.raises(netlib.PrototxtError):
            prototxt.parse(f"name: {text}")


@pytest.mark.parametrize(
    "line",
    ["Iteration 1 (", "Iteration 1 (x), ", "Iteration 1 " + ")" * 9, "Test net output #1: ", "1"],
)
def test_a_long_line_of_a_log(tmp_path: Path, line: str) -> None:
    """A long line that is not one of a log is skipped quickly."""
    path = tmp_path / "train.log"
    path.write_text(
        "Iteration " + line * 50_000 + "\nIteration 7 (2 iter/s, 1s/2 iters), loss = 0.5\n"
    )
    assert read_log(path) == {LOSS: [(7, 0.5)]}
