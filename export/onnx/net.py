"""Export of a trained net to ONNX, and the table of layer types and the functions that add
their operators.

A function takes the graph and the LayerCall and returns the names of the tops' values. A layer
without effect returns the values of its bottoms. Options and formulas are documented in the layer's
file in layers/; comments note where ONNX's operators differ from Caffe's.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from export.onnx import common, hand, vision
from export.onnx.graph import OPSET, PRODUCER, Graph, LayerCall, Shape, Translation, symbolic
from layers.hand.hand_model import HandModel
from netlib.errors import LayerError, NetlibError, did_you_mean
from netlib.net import Net
from netlib.proto.messages import LayerParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.options import layer_types
from netlib.proto.schema import position_of
from netlib.training.trained import trained

Shapes = list[tuple[list[Shape], list[Shape]]]  # shapes of each layer's bottoms and tops

_CONV = partial(vision.sliding, op="Conv")
LAYERS: dict[str, Translation] = {
    "AbsVal": common.of_each("Abs"),
    "ArgMax": common.arg_max,
    "Axpy": common.axpy,
    "BN": common.bn,
    "BNLL": common.of_each("Softplus"),
    "BatchNorm": common.batch_norm,
    "BatchReindex": common.batch_reindex,
    "Bias": common.bias,
    "Clip": common.clip,
    "Concat": common.concat,
    "Convolution": _CONV,
    "ConvolutionDepthwise": _CONV,
    "Crop": vision.crop,
    "Deconvolution": partial(vision.sliding, op="ConvTranspose"),
    "DeepHandModel": hand.hand_model,  # name in the released system
    "DetectionOutput": vision.detection_output,
    "DepthwiseConvolution": _CONV,
    "Dropout": common.dropout,
    "ELU": common.elu,
    "Eltwise": common.eltwise,
    "Embed": common.embed,
    "Exp": common.exp,
    "Flatten": common.shaped_as_top,
    "HandModel": hand.hand_model,
    "InnerProduct": common.inner_product,
    "Input": common.nothing,  # inputs are part of the graph
    "Interp": vision.interp,
    "LRN": common.lrn,
    "Log": common.log,
    "MVN": common.mvn,
    "Normalize": common.normalize,
    "PReLU": common.prelu,
    "Parameter": common.parameter,
    "Permute": common.permute,
    "Pooling": vision.pooling,
    "Power": common.power,
    "PriorBox": vision.prior_box,
    "ReLU": common.relu,
    "ReLU6": common.relu6,
    "Reduction": common.reduction,
    "Reshape": common.shaped_as_top,
    "SPP": vision.spp,
    "Scale": common.scale,
    "ShuffleChannel": common.shuffle_channel,
    "Sigmoid": common.of_each("Sigmoid"),
    "Silence": common.nothing,
    "Slice": common.slice_,
    "Softmax": common.softmax,
    "Split": common.same,
    "Swish": common.swish,
    "TanH": common.of_each("Tanh"),
    "Threshold": common.threshold,
    "Tile": common.tile,
    "Upsample": vision.upsample,
}


def load(model: str | Path, weights: str | Path) -> Net:
    """Load a net in phase TEST with its weights.

    Raises NetlibError, also for a layer type that cannot be exported.
    """
    for spec in select_layers(load_parameter(model), NetState("TEST")):
        if spec.type in layer_types() or spec.type == "Python":  # Net reports unknown types
            _translation(spec)
    return trained(model, weights, engine="plain")  # the plain layers store their options by name


def _translation(spec: LayerParameter) -> Translation:
    """Return the translation of a layer. Raises LayerError for a type that cannot be exported."""
    if spec.type not in LAYERS:
        raise LayerError(
            f"{position_of(spec, 'type')}: error: layer {spec.name!r}: type {spec.type!r} cannot be exported to ONNX "
            "(docs/onnx.md); expected a deploy net, without layers for data, labels and losses"
        )
    return LAYERS[spec.type]


def onnx_image(
    net: Net, also: Sequence[str] = (), cube_mm: float | None = None, opset: int = OPSET
) -> bytes:
    """Export a net in phase TEST as ONNX and return the bytes; the first axis of every input
    is the batch, N.

    ``also`` names additional output blobs. ``cube_mm`` is the edge length of the crop cube in mm,
    for the metadata of a net with a hand model; None leaves it out. Raises NetlibError, also if an
    operator needs a later ``opset``, which is from 11 to 17.
    """
    graph = Graph(net.blobs, opset)
    graph.values = {name: name for name in net.inputs}
    shapes: dict[str, Shape] = {}  # of blobs, after the layers so far
    hands: list[tuple[HandModel, str]] = []  # hand models, with the values that are their poses
    for at, (bottom, top) in zip(net.connections, shapes_of(net)):
        if at.layer.is_input:
            shapes.update(zip(at.layer.spec.top, top))
            continue
        values = [graph.values[name] for name in at.layer.spec.bottom]
        if isinstance(at.layer, HandModel):
            hands.append((at.layer, values[0]))
        _add_layer(graph, LayerCall(at.layer, values, bottom, top), shapes)
    outputs = _outputs(net, also)
    metadata = {"producer": PRODUCER, "net": net.name}
    if hands:
        hand_model, pose = hands[0]
        metadata |= _metadata(hand_model, cube_mm)
        if pose in [graph.values[name] for name in outputs]:
            metadata["dof_names"] = json.dumps(hand_model.skeleton.dof_names)
    return graph.finish(
        net.name,
        {name: shapes[name] for name in net.inputs},
        {name: shapes[name] for name in outputs},
        metadata,
    )


def _add_layer(graph: Graph, call: LayerCall, shapes: dict[str, Shape]) -> None:
    """Add the operators of a layer, and set the values and the ``shapes`` of its tops.

    Raises LayerError if it cannot be exported.
    """
    layer, spec = call.layer, call.layer.spec
    for name, shape in zip(spec.bottom, call.bottom):
        if shapes[name] != shape and layer.type != "Silence":
            raise layer.fail(
                f"reads {name!r}, whose number of rows depends on values, which cannot be exported "
                "to ONNX; expected no layer behind it"
            )
    graph.layer = layer.name
    graph.values.update(zip(spec.top, _translation(spec)(graph, call)))
    shapes.update(zip(spec.top, call.top))


def _metadata(layer: HandModel, cube_mm: float | None) -> dict[str, str]:
    """Return the metadata of a net with a hand model."""
    metadata = {
        "joint_names": json.dumps(layer.skeleton.joint_names),
        "unit": "half-cubes",
        "axes": "x right, y up, z away",
        "input_range": "[-1, 1]",
    }
    if cube_mm is not None:
        metadata["cube_mm"] = f"{cube_mm:g}"
    return metadata


def _outputs(net: Net, also: Sequence[str]) -> list[str]:
    """Return the names of the output blobs. Raises NetlibError."""
    if not net.inputs:
        raise NetlibError(f"{net.source}: no Input layer; expected a deploy net")
    outputs = list(dict.fromkeys([*net.outputs, *also]))
    if not outputs:
        raise NetlibError(
            f"{net.source}: no layer leaves a blob unread, so the net has no output; name one (--blob)"
        )
    for name in outputs:
        if name not in net.blobs:
            raise NetlibError(
                f"net {net.name!r} has no blob {name!r}{did_you_mean(name, net.blobs)}"
            )
        if name in net.inputs:
            raise NetlibError(
                f"{net.source}: blob {name!r} is both input and output, which ONNX does not "
                "support; expected a layer that reads it, with another top, or no such input"
            )
    return outputs


def shapes_of(net: Net) -> Shapes:
    """Return the shapes of each layer's bottoms and tops for N items, from reshaping the net to
    2 and 3 items.

    Afterwards the net has its original shapes. Raises LayerError if it cannot be reshaped.
    """
    declared = {name: net.blobs[name].shape for name in net.inputs}
    for name, shape in declared.items():
        if not shape:
            raise LayerError(
                f"{net.source}: input {name!r} has no shape; expected input_param {{ shape {{ ... }} }}"
            )
    if len({shape[0] for shape in declared.values()}) > 1:
        inputs = ", ".join(f"{name} {shape}" for name, shape in declared.items())
        raise LayerError(
            f"{net.source}: inputs with different batch sizes, {inputs}; "
            "expected first axes of the same size"
        )
    of_two, of_three = (_shapes_of_batch(net, declared, batch) for batch in (2, 3))
    for name, shape in declared.items():
        net.blobs[name].reshape(shape)
    net.reshape()
    shapes: Shapes = []
    for at, two, three in zip(net.connections, of_two, of_three):
        both = [[symbolic(a, b) for a, b in zip(*sides)] for sides in zip(two, three)]
        bottom, top = ([shape for shape in side if shape is not None] for side in both)
        if [bottom, top] != both:
            raise at.layer.fail(
                f"shape {two[1]} for 2 items, {three[1]} for 3 cannot be exported to ONNX; expected "
                "one axis that depends on the number of items"
            )
        shapes.append((bottom, top))
    return shapes


def _shapes_of_batch(net: Net, declared: Mapping[str, Sequence[int]], batch: int) -> list[Any]:
    """Reshape a net to ``batch`` items; returns the shapes of each layer's bottoms and tops."""
    for name, shape in declared.items():
        net.blobs[name].reshape(batch, *shape[1:])
    try:
        net.reshape()
    except LayerError as error:
        raise LayerError(
            f"{error} (with {batch} items); expected a net that accepts any number"
        ) from error
    return [([b.shape for b in at.bottom], [t.shape for t in at.top]) for at in net.connections]
