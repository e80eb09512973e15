"""ONNX graph builder: collects operators and constants, then serializes the model.

Files have opset 17 and IR version 8, of ONNX 1.12 (June 2022), for compatibility; tested with
onnxruntime 1.16 to 1.31 and OpenCV 4.8 to 5.0. Older runtimes need an older opset, down to 11;
before opset 15 Shape has no range of axes. Opset 18 changes the form of reductions.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from netlib.errors import NetlibError, reason_of

OPSET = 17
# IR version of the ONNX release with each opset.
IR_VERSIONS = {11: 6, 12: 7, 13: 7, 14: 7, 15: 8, 16: 8, 17: 8}
RANGE_OF_SHAPE = 15  # the opset from which Shape has a range of axes
# The opset from which operators have the form that they have here.
FIRST_OPSETS = {
    "GatherND": 12,
    "ReduceSum": 13,
    "Resize": 13,  # without the inputs that its mode does not read
    "Softmax": 13,
    "Split": 13,
    "Unsqueeze": 13,
}
PRODUCER = "handpose"
MAX_BYTES = 2**31 - 1  # limit of a protocol buffer

Shape = tuple[int | str, ...]  # "N" is the batch size, "4*N" four times as much


@dataclass(frozen=True)
class LayerCall:
    """A layer, applied to values of the graph.

    layer        the layer, with its options and parameters
    values       the names of the values of its bottoms
    bottom, top  the shapes of its bottoms and tops; a translation replaces that of a top whose size
                 depends on values
    """

    layer: Any  # its attributes depend on the type
    values: list[str]
    bottom: list[Shape]
    top: list[Shape]

    def sizes(self, shape: Shape) -> list[int]:
        """Return a shape as constants. Raises LayerError if it depends on the batch size."""
        known = [n for n in shape if isinstance(n, int)]
        if len(known) < len(shape):
            raise self.layer.fail(
                f"{self.layer.type} along the batch axis cannot be exported to ONNX; "
                f"shape ({', '.join(map(str, shape))})"
            )
        return known


class Graph:
    """Operators and constants in the order of addition.

    ``values`` maps every blob to the name of its current value. ``taken`` are names reserved
    for ``finish``.
    """

    def __init__(self, taken: Iterable[str], opset: int = OPSET) -> None:
        self.opset = opset
        # arguments of make_node
        self.nodes: list[tuple[str, Sequence[str], Sequence[str], Mapping[str, Any]]] = []
        self.constants: dict[str, np.ndarray[Any, Any]] = {}
        self.values: dict[str, str] = {}
        self.layer = ""  # the layer being translated, the prefix of operator names
        self._taken = set(taken)

    def op(self, op: str, *inputs: str, **attributes: Any) -> str:
        """Add an operator with one output; returns the output's name."""
        return self.ops(op, 1, *inputs, **attributes)[0]

    def ops(self, op: str, outputs: int, *inputs: str, **attributes: Any) -> list[str]:
        """Add an operator; returns the names of its outputs.

        Raises NetlibError if the opset has another form of it.
        """
        if (first := FIRST_OPSETS.get(op, 0)) > self.opset:
            raise NetlibError(
                f"layer {self.layer!r} needs the operator {op} of opset {first}, found opset {self.opset}; expected "
                f"--opset {first} or more"
            )
        name = self._fresh(op)
        values = [name, *(self._fresh(f"{op}_{i}") for i in range(1, outputs))]
        self.nodes.append((op, inputs, tuple(values), {"name": name, **attributes}))
        return values

    def constant(self, values: ArrayLike, what: str = "constant") -> str:
        """Add a constant as float32 or int64; returns its name."""
        array = np.asarray(values)
        name = self._fresh(what)
        self.constants[name] = array.astype(np.int64 if array.dtype.kind in "iub" else np.float32)
        return name

    def reshaped(self, value: str, shape: Shape) -> str:
        """Reshape a value; at most one axis may have a symbolic size, which is inferred."""
        sizes = [-1 if isinstance(n, str) else n for n in shape]
        return self.op("Reshape", value, self.constant(sizes, "shape"))

    def affine(self, value: str, scale: float, shift: float) -> str:
        """Compute scale x + shift, without operators that have no effect."""
        if scale != 1:
            value = self.op("Mul", value, self.constant(float(scale), "scale"))
        if shift != 0:
            value = self.op("Add", value, self.constant(float(shift), "shift"))
        return value

    def widened(self, value: str, axes: int, first: int, all_axes: int) -> str:
        """Append axes of size 1 to a value with ``axes`` axes, so that it broadcasts to x from
        axis ``first`` on.
        """
        appended = list(range(axes, all_axes - first))
        if not appended:
            return value
        return self.op("Unsqueeze", value, self.constant(appended, "axes"))

    def sliced(
        self, value: str, starts: Sequence[int], ends: Sequence[int], axes: Sequence[int]
    ) -> str:
        """Cut a value along some axes."""
        bounds = map(self.constant, (starts, ends, axes), ("starts", "ends", "axes"))
        return self.op("Slice", value, *bounds)

    def shape_of(self, value: str, start: int, end: int) -> str:
        """The sizes of the axes from ``start`` up to but not including ``end``, as a value."""
        if self.opset >= RANGE_OF_SHAPE:
            return self.op("Shape", value, start=start, end=end)
        return self.sliced(self.op("Shape", value), [start], [end], [0])

    def to_float(self, value: str) -> str:
        """Cast a value to float32."""
        return self.op("Cast", value, to=1)  # FLOAT

    def to_int(self, value: str) -> str:
        """Cast a value to int64."""
        return self.op("Cast", value, to=7)  # INT64

    def _fresh(self, what: str) -> str:
        name = f"{self.layer}/{what}"
        i = 1
        while name in self._taken:
            i += 1
            name = f"{self.layer}/{what}{i}"
        self._taken.add(name)
        return name

    def finish(
        self,
        name: str,
        inputs: Mapping[str, Shape],
        outputs: Mapping[str, Shape],
        metadata: dict[str, str],
    ) -> bytes:
        """Serialize the model.

        Values are named after their blobs, outputs first. Raises NetlibError, also without onnx.
        """
        names = self._names_of_values(inputs, outputs)
        size = sum(array.nbytes for array in self.constants.values())
        onnx = package("onnx")
        if size > MAX_BYTES:
            raise NetlibError(
                f"net {name!r} has {size / 1e9:.1f} GB of weights; expected at most 2.1 GB, the limit of ONNX files"
            )
        make = onnx.helper
        dtype = onnx.TensorProto.FLOAT

        def node(op: str, reads: Sequence[str], writes: Sequence[str], attributes: Any) -> Any:
            named = ([names.get(value, value) for value in values] for values in (reads, writes))
            return make.make_node(op, *named, **attributes)

        def infos(blobs: Mapping[str, Shape]) -> list[Any]:
            return [
                make.make_tensor_value_info(blob, dtype, shape) for blob, shape in blobs.items()
            ]

        nodes = [node(*arguments) for arguments in self.nodes]
        constants = [
            onnx.numpy_helper.from_array(array, key) for key, array in self.constants.items()
        ]
        graph = make.make_graph(nodes, name or "net", infos(inputs), infos(outputs), constants)
        model = make.make_model(
            graph,
            producer_name=PRODUCER,
            opset_imports=[make.make_opsetid("", self.opset)],
            ir_version=IR_VERSIONS[self.opset],
        )
        make.set_model_props(model, metadata)
        try:
            onnx.checker.check_model(model, full_check=True)
        except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
            raise NetlibError(
                f"net {name!r}: its export is not valid ONNX: {reason_of(error)}"
            ) from error
        return bytes(model.SerializeToString())

    def _names_of_values(self, inputs: Iterable[str], outputs: Iterable[str]) -> dict[str, str]:
        """The names of values in the file: those of their blobs, of outputs first.

        An output that is an input, a constant or another output gets a value of its own.
        """
        self.layer = "outputs"
        names = {name: name for name in inputs}
        for blob in outputs:
            value = self.values[blob]
            if value in names or value in self.constants:
                value = self.op("Identity", value)
            names[value] = blob
        for blob, value in self.values.items():
            if value not in self.constants and blob not in names.values():
                names.setdefault(value, blob)
        return names


# adds a layer's operators; returns the names of its tops' values
Translation = Callable[[Graph, LayerCall], list[str]]


def package(name: str) -> Any:
    """Import the package onnx or onnxruntime on demand. Raises NetlibError if it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise NetlibError(f"{name} is missing: pip install onnx onnxruntime") from error


def symbolic(two: Sequence[int], three: Sequence[int]) -> Shape | None:
    """Return the shape of a blob for N items, from those for 2 and for 3; None unless at most one
    axis depends on N.
    """
    if len(two) != len(three):
        return None
    shape: list[int | str] = []
    for a, b in zip(two, three):
        if a != b and 3 * a != 2 * b:
            return None
        of_batch = "N" if a == 2 else f"{a // 2}*N"
        shape.append(a if a == b else of_batch)
    return tuple(shape) if sum(isinstance(n, str) for n in shape) < 2 else None
