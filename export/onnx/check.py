"""Comparison of an exported file in onnxruntime with its net, computed in float64.

Float32 rounds a value by up to 6e-8 of it, and a net can amplify this: the relative error of a
Softmax is the absolute error of its logits, and where large values cancel, their error remains. So
the allowed difference is ``TOLERANCE`` plus ``FACTOR`` times the measured effect of rounding, all
relative to the largest value. Two kinds of values are compared:

outputs   Values of the file and of the net. Effect of rounding: the error of the net in float32.
layers    Values of each layer in the file, and of the net's layer computed from the same bottoms.
          Effect of rounding: the change of the tops when bottoms and parameters change by half a
          unit in the last place, the error that any float32 computation may have. This finds
          mistakes that a later layer hides, such as a saturated Softmax.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from export.onnx.graph import package
from netlib.blob import Array
from netlib.engine import Connection
from netlib.net import Net
from netlib.training.trained import Unfilled

TOLERANCE = 1e-5
# For correct nets that amplify rounding, onnxruntime's error is up to 4.4 times this effect.
FACTOR = 10
HALF_UNIT = 2.0**-24  # in the last place of float32, relative to the value
# Layers that select values: rounding errors of their bottoms would change the selection.
SELECTING = ("ArgMax", "BatchReindex", "DetectionOutput", "Embed", "Threshold", "Upsample")


@dataclass(frozen=True)
class Difference:
    """The largest differences of a blob from its values in float64, relative to the largest value.

    found     difference of onnxruntime's values
    rounding  effect of rounding to float32
    """

    found: float = 0.0
    rounding: float = 0.0

    @property
    def limit(self) -> float:
        """The largest difference that rounding explains."""
        return TOLERANCE + FACTOR * self.rounding

    def __or__(self, other: Difference) -> Difference:
        """The larger one of both numbers."""
        return Difference(max(self.found, other.found), max(self.rounding, other.rounding))


def compared(y: Array, rounded: Array, exact: Array) -> Difference:
    """Compare onnxruntime's values, and values with rounding errors, with those in float64."""
    with np.errstate(over="ignore"):
        exact = exact.astype(np.float32)
    found, rounding = difference(y, exact), difference(rounded, exact)
    if np.isinf(rounding):  # float32 overflows before this blob, as it may in onnxruntime
        return Difference(min(found, difference(y, rounded)))
    return Difference(found, rounding)


def difference(y: Array, expected: Array) -> float:
    """Return the largest difference relative to the largest finite expected value; inf if shapes or
    non-finite values differ.
    """
    if y.shape != expected.shape:
        return np.inf
    with np.errstate(invalid="ignore"):
        error = np.abs(y - expected)
    is_same = (y == expected) | (np.isnan(y) & np.isnan(expected))
    error = np.where(is_same, 0, error)
    error = np.where(np.isnan(error), np.inf, error)
    scale = np.abs(expected[np.isfinite(expected)]).max(initial=0)
    return float(error.max(initial=0) / (scale or 1))


def differences(
    exported: bytes, net: Net, batches: Sequence[int]
) -> tuple[dict[str, Difference], dict[str, Difference]]:
    """Compare a file with its net, in phase TEST, for random inputs in [-1, 1] with
    these batch sizes.

    Returns the differences of the outputs by name, and those of the blobs that a layer computes
    from onnxruntime's values. Of a detector, the first are its locations and confidences, and the
    rows that its layer selects from onnxruntime's: of confidences that are equal up to rounding,
    either may come first. Raises NetlibError.
    """
    detectors = [layer.spec for layer in net.layers if layer.type == "DetectionOutput"]
    selected = {spec.top[0] for spec in detectors}
    before_selection = [name for spec in detectors for name in spec.bottom]
    session = _session(_with_outputs(exported, before_selection))
    session_of_blobs = _session(_with_outputs(exported, net.blobs))
    exact = _in_float64(net)
    rng = np.random.default_rng(0)
    names = [output.name for output in session.get_outputs()]
    outputs = dict.fromkeys(names, Difference())
    layers: dict[str, Difference] = {}
    for batch in batches:
        inputs: dict[str, Any] = {name: _random(net, name, batch, rng) for name in net.inputs}
        found = _run(session, inputs)
        rounded = net.forward(blobs=names, **inputs)
        expected = exact.forward(blobs=names, **inputs)
        for name in outputs.keys() - selected:
            outputs[name] |= compared(found[name], rounded[name], expected[name])
        found_blobs = _run(session_of_blobs, inputs)
        for name, of_layer in _of_layers(exact, inputs, found_blobs, rng):
            layers[name] = layers.get(name, Difference()) | of_layer
    for name in outputs.keys() & selected:
        outputs[name] = layers[name]
    return outputs, layers


def _of_layers(
    exact: Net, inputs: Mapping[str, Array], found: Mapping[str, Array], rng: np.random.Generator
) -> Iterator[tuple[str, Difference]]:
    """Compare each blob in ``found`` with what its layer computes from the blobs in ``found``
    that it reads.
    """
    # The last writer of each blob: layers in place overwrite the values of earlier ones.
    writers = {name: at for at in exact.connections for name in at.layer.spec.top}
    for number, at in enumerate(exact.connections):
        tops = dict(zip(at.layer.spec.top, at.top))
        if at.layer.is_input:
            for name, blob in tops.items():
                blob.data[...] = inputs[name]
            continue
        with _rounding_errors(at, rng):
            exact.run_forward(number, number + 1)
            rounded = {name: blob.data.copy() for name, blob in tops.items()}
        exact.run_forward(number, number + 1)
        for name, blob in tops.items():
            if name in found and writers[name] is at:
                yield name, compared(found[name], rounded[name], blob.data)
                if found[name].shape == blob.shape:
                    blob.data[...] = found[name]


@contextmanager
def _rounding_errors(at: Connection, rng: np.random.Generator) -> Iterator[None]:
    """Temporarily change the bottoms and parameters of a layer by half a unit in the last
    place of float32.
    """
    arrays = [blob.data for blob in dict.fromkeys([*at.bottom, *at.layer.blobs])]
    before = [array.copy() for array in arrays]
    if at.layer.type not in SELECTING:
        for array in arrays:
            array *= 1 + rng.choice([-HALF_UNIT, HALF_UNIT], array.shape)
    try:
        yield
    finally:
        for array, values in zip(arrays, before):
            array[...] = values


def _in_float64(net: Net) -> Net:
    """The same net in float64, with the same weights."""
    logger = logging.getLogger("netlib")
    before = logger.disabled
    logger.disabled = True  # the net has given its warnings
    try:
        exact = Net(
            net.param, state=net.state, dtype=np.float64, engine="plain", layer_hook=Unfilled()
        )
    finally:
        logger.disabled = before
    exact.copy_from(net)
    return exact


def _session(exported: bytes) -> Any:
    runtime = package("onnxruntime")
    options = runtime.SessionOptions()
    options.log_severity_level = 3  # errors only
    return runtime.InferenceSession(exported, options, providers=["CPUExecutionProvider"])


def _run(session: Any, inputs: dict[str, Array]) -> dict[str, Array]:
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs)))


def _with_outputs(exported: bytes, names: Iterable[str]) -> bytes:
    """Make those of the named values outputs that operators compute."""
    onnx = package("onnx")
    model = onnx.load_from_string(exported)
    added = set(names).difference(output.name for output in model.graph.output)
    for node in model.graph.node:
        for name in node.output:
            if name in added:
                info = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None)
                model.graph.output.append(info)
    return bytes(model.SerializeToString())


def _random(net: Net, name: str, batch: int, rng: np.random.Generator) -> Array:
    """Return random values for an input: in [-1, 1], or integers for a layer that reads indices."""
    shape = (batch, *net.blobs[name].shape[1:])
    names = {name}  # of the input and its copies
    for layer in net.layers:
        spec: Any = layer.spec
        if layer.type == "Split" and spec.bottom[0] in names:
            names.update(spec.top)
        if layer.type == "Embed" and spec.bottom[0] in names:
            return rng.integers(0, layer.param.input_dim, shape).astype(np.float32)
        if layer.type == "BatchReindex" and spec.bottom[1] in names:
            return rng.integers(0, batch, shape).astype(np.float32)
    return rng.uniform(-1, 1, shape).astype(np.float32)
