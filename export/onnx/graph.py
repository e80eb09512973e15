"""An ONNX graph in the making: operators and constants, one after the other, and at the end the file.

The file is of opset 17 and IR version 8, those of ONNX 1.12 (June 2022), which every runtime of the last three years
reads; tried with onnxruntime 1.16 to 1.31 and OpenCV 4.8 to 5.0. Nothing newer is needed, and from opset 18 on
reductions have another form.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from netlib.errors import NetlibError, reason_of
from netlib.layer import Layer

OPSET, IR_VERSION = 17, 8
PRODUCER = "deepmodel-numpy"
MOST_BYTES = 2**31 - 1  # of one protocol buffer

Shape = tuple[int | str, ...]  # sizes of axes; "N" is the batch, "4*N" four times as much


@dataclass(frozen=True)
class Node:
    """An operator with the names of the values that it reads and writes."""

    op: str
    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, Any]


@dataclass(frozen=True)
class Place:
    """A layer at its place in the graph.

    layer        the layer, with its options and parameters
    values       the names of the values that its bottoms are
    bottom, top  the shapes of its bottoms and tops
    """

    layer: Layer
    values: list[str]
    bottom: list[Shape]
    top: list[Shape]

    def sizes(self, shape: Shape) -> list[int]:
        """Sizes that must be known before the batch is. Raises LayerError."""
        known = [n for n in shape if isinstance(n, int)]
        if len(known) < len(shape):
            raise self.layer.fail(f"{self.layer.type} along the batch has no form in ONNX; shape ({_text(shape)})")
        return known


class Graph:
    """Operators and constants in the order in which they are added.

    ``values`` gives for every blob the name of the value that it has at this point. ``taken`` are names that only
    ``finish`` gives.
    """

    def __init__(self, taken: Iterable[str]) -> None:
        self.nodes: list[Node] = []
        self.constants: dict[str, np.ndarray[Any, Any]] = {}
        self.values: dict[str, str] = {}
        self.layer = ""  # whose operators are being added; begins their names
        self._taken = set(taken)

    def op(self, op: str, *inputs: str, **attributes: Any) -> str:
        """Add an operator with one output; returns that value's name."""
        return self.ops(op, 1, *inputs, **attributes)[0]

    def ops(self, op: str, outputs: int, *inputs: str, **attributes: Any) -> list[str]:
        """Add an operator; returns the names of its outputs."""
        name = self._fresh(op)
        values = [name, *(self._fresh(f"{op}_{i}") for i in range(1, outputs))]
        self.nodes.append(Node(op, name, inputs, tuple(values), attributes))
        return values

    def constant(self, values: ArrayLike, what: str = "constant") -> str:
        """Add a constant, float32 or int64; returns its name."""
        array = np.asarray(values)
        name = self._fresh(what)
        self.constants[name] = array.astype(np.int64 if array.dtype.kind in "iub" else np.float32)
        return name

    def reshaped(self, value: str, shape: Shape) -> str:
        """The value in another shape, of which at most one axis has a symbolic size: what the others leave over."""
        return self.op("Reshape", value, self.constant([-1 if isinstance(n, str) else n for n in shape], "shape"))

    def affine(self, value: str, scale: float, shift: float) -> str:
        """scale x + shift, without what changes nothing."""
        if scale != 1:
            value = self.op("Mul", value, self.constant(float(scale), "scale"))
        return self.op("Add", value, self.constant(float(shift), "shift")) if shift != 0 else value

    def widened(self, value: str, axes: int, first: int, all_axes: int) -> str:
        """A value with ``axes`` axes, and axes of size 1 behind them: they meet those of x from ``first`` on."""
        behind = all_axes - first - axes
        if not behind:
            return value
        return self.op("Unsqueeze", value, self.constant(list(range(axes, axes + behind)), "axes"))

    def floats(self, value: str) -> str:
        """The value as float32."""
        return self.op("Cast", value, to=1)  # FLOAT

    def whole(self, value: str) -> str:
        """The value as int64."""
        return self.op("Cast", value, to=7)  # INT64

    def _fresh(self, what: str) -> str:
        name, i = f"{self.layer}/{what}", 1
        while name in self._taken:
            i += 1
            name = f"{self.layer}/{what}{i}"
        self._taken.add(name)
        return name

    def finish(
        self, name: str, inputs: Mapping[str, Shape], outputs: Mapping[str, Shape], metadata: Mapping[str, str]
    ) -> bytes:
        """The file. Values get the names of their blobs, outputs first. Raises NetlibError, also without onnx."""
        self.layer = "outputs"
        given = {name: name for name in inputs}
        for blob in outputs:
            value = self.values[blob]
            if value in given or value in self.constants:  # has a name already
                value = self.op("Identity", value)
            given[value] = blob
        for blob, value in self.values.items():
            if value not in given and value not in self.constants and blob not in given.values():
                given[value] = blob
        onnx, size = package("onnx"), sum(array.nbytes for array in self.constants.values())
        if size > MOST_BYTES:
            raise NetlibError(f"net {name!r} has {size / 1e9:.1f} GB of weights; an ONNX file holds at most 2.1 GB")
        make, typed = onnx.helper, onnx.TensorProto.FLOAT
        graph = make.make_graph(
            [make.make_node(n.op, [given.get(v, v) for v in n.inputs], [given.get(v, v) for v in n.outputs], n.name,
                            **n.attributes) for n in self.nodes],
            name or "net",
            [make.make_tensor_value_info(blob, typed, shape) for blob, shape in inputs.items()],
            [make.make_tensor_value_info(blob, typed, shape) for blob, shape in outputs.items()],
            [onnx.numpy_helper.from_array(array, constant) for constant, array in self.constants.items()],
        )  # fmt: skip
        model = make.make_model(
            graph, producer_name=PRODUCER, opset_imports=[make.make_opsetid("", OPSET)], ir_version=IR_VERSION
        )
        make.set_model_props(model, dict(metadata))
        try:
            onnx.checker.check_model(model, full_check=True)
        except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
            raise NetlibError(f"net {name!r}: what was made of it is not valid ONNX: {reason_of(error)}") from error
        made: bytes = model.SerializeToString()
        return made


Translation = Callable[[Graph, Place], list[str]]  # adds a layer's operators; returns the values that its tops are


def package(name: str) -> Any:
    """The package onnx or onnxruntime, loaded when it is needed. Raises NetlibError if it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise NetlibError(f"{name} is missing: pip install onnx onnxruntime") from error


def symbolic(two: Sequence[int], three: Sequence[int]) -> Shape | None:
    """The shape that a blob has for N items, from those for 2 and for 3; None if there is none with N once at most."""
    if len(two) != len(three):
        return None
    shape: list[int | str] = []
    for a, b in zip(two, three):
        if a != b and 3 * a != 2 * b:
            return None
        shape.append(a if a == b else "N" if a == 2 else f"{a // 2}*N")
    return tuple(shape) if sum(isinstance(n, str) for n in shape) < 2 else None


def _text(shape: Shape) -> str:
    return ", ".join(map(str, shape))
