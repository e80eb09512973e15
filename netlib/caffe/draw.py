"""caffe.draw: images of a net's graph, drawn by the package pydot and the Graphviz program dot.

Both are required only when a net is drawn. Unlike Caffe's, a layer in place stands in the box of
the layer before it, and edges carry the shapes of blobs if they are known.
"""

from __future__ import annotations

import importlib
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from netlib.caffe.proto import caffe_pb2
from netlib.errors import NetlibError
from netlib.files import atomic, reading

LAYER_STYLE_DEFAULT = {"shape": "record", "fillcolor": "#6495ED", "style": "filled"}
# layers in place
NEURON_LAYER_STYLE = {"shape": "record", "fillcolor": "#90EE90", "style": "filled"}
BLOB_STYLE = {"shape": "octagon", "fillcolor": "#E0E0E0", "style": "filled"}
COLORS = {
    "Convolution": "#FF5050",
    "Deconvolution": "#FF5050",
    "Pooling": "#FF9900",
    "InnerProduct": "#CC33FF",
}
NOTHING = '""'  # an empty label
Shapes = Mapping[str, Sequence[int]]  # of blobs, by their names
GRAPHVIZ = "Graphviz (apt install graphviz, brew install graphviz)"
_WITH_WEIGHTS = ("Convolution", "Deconvolution", "InnerProduct")
_WORDS = ("node", "edge", "graph", "digraph", "subgraph", "strict")  # Graphviz's keywords


class RuleError(NetlibError, ValueError):
    """A layer whose rules or options do not determine how to draw it."""


def get_pooling_types_dict() -> dict[int, str]:
    """Pooling methods: number -> name."""
    kinds = caffe_pb2.LayerParameter().pooling_param.PoolMethod
    return {number: name for name, number in kinds.items()}


def get_edge_label(layer: Any) -> str:
    """Label of the arrows out of a layer: batch size or number of outputs, if any."""
    if layer.type == "Data":
        return f"Batch {layer.data_param.batch_size}"
    if layer.type in ("Convolution", "Deconvolution"):
        return str(layer.convolution_param.num_output)
    if layer.type == "InnerProduct":
        return str(layer.inner_product_param.num_output)
    return NOTHING


def get_layer_lr_mult(layer: Any) -> tuple[float, float]:
    """The lr_mult of weights and biases, default 1. Raises RuleError for layers without weights."""
    if layer.type not in _WITH_WEIGHTS:
        raise RuleError(f"{layer.type} layers do not have a learning rate multiplier")
    given = [param.lr_mult for param in layer.param]
    if len(given) > 2:
        raise RuleError(
            f"layer {layer.name!r}: expected at most two params, weights and biases, found {len(given)}"
        )
    weights, biases = [*given, 1.0, 1.0][:2]
    return weights, biases


def get_layer_label(layer: Any, rankdir: str, display_lrm: bool = False) -> str:
    """Label of a layer's box, in quotes: name, type, kernel, and with ``display_lrm`` its learning
    rate multipliers.

    Vertical graphs ("TB", "BT") have room for one long line; in others the label has several lines.
    """
    separator = " " if rankdir in ("TB", "BT") else r"\n"
    kind = layer.type
    if kind == "Pooling":
        kind += f" {get_pooling_types_dict()[layer.pooling_param.pool]}"
    parts = [_escaped(layer.name), f"({kind})"]
    if layer.type == "Pooling":
        param = layer.pooling_param
        parts += _kernel(param.kernel_size, param.stride, param.pad)
    elif layer.type in ("Convolution", "Deconvolution"):
        param = layer.convolution_param
        parts += _kernel([*param.kernel_size, 1][0], [*param.stride, 1][0], [*param.pad, 0][0])
    if display_lrm and layer.type in _WITH_WEIGHTS:
        weights, biases = get_layer_lr_mult(layer)
        if weights or biases:
            parts.append(f"lr mult: {weights:.1f}, {biases:.1f}")
    return f'"{separator.join(parts)}"'


def _kernel(size: int, stride: int, pad: int) -> list[str]:
    return [f"kernel size: {size}", f"stride: {stride}", f"pad: {pad}"]


def choose_color_by_layertype(layertype: str) -> str:
    """Fill colour of a layer's box."""
    return COLORS.get(layertype, LAYER_STYLE_DEFAULT["fillcolor"])


def get_pydot_graph(
    caffe_net: Any,
    rankdir: str,
    label_edges: bool = True,
    phase: int | None = None,
    display_lrm: bool = False,
    shapes: Shapes | None = None,
) -> Any:
    """Build the pydot graph of a NetParameter: layers as boxes, blobs as octagons.

    ``rankdir`` is its direction, "LR", "TB" or "BT". ``label_edges`` adds shapes to the arrows, or
    sizes without ``shapes``, those of the blobs by their names. ``phase`` limits it to the layers
    of caffe.TRAIN or caffe.TEST. Raises NetlibError if pydot is missing, RuleError.
    """
    try:
        pydot = importlib.import_module("pydot")
    except ImportError as error:
        raise NetlibError(
            f"pydot is missing: pip install pydot; pictures also need {GRAPHVIZ}"
        ) from error
    graph = pydot.Dot(_quoted(caffe_net.name or "Net"), graph_type="digraph", rankdir=rankdir)
    chosen = [layer for layer in caffe_net.layer if phase is None or _is_in(layer, phase)]
    groups = _with_layers_in_place(chosen)
    blobs = dict.fromkeys(name for layer in chosen for name in [*layer.bottom, *layer.top])
    nodes = {name: pydot.Node(_quoted(name), **BLOB_STYLE) for name in blobs}
    boxes = [
        pydot.Node(_box_label(group, rankdir, display_lrm), **_style(group[0])) for group in groups
    ]
    for node in [*boxes, *nodes.values()]:
        graph.add_node(node)
    known = shapes if shapes and label_edges else {}
    made = {name for layer in chosen for name in layer.top}
    for box, (first, *_) in zip(boxes, groups):
        size = get_edge_label(first) if label_edges else NOTHING
        for name in first.bottom:
            label = NOTHING if name in made else _shape_label(known, name, NOTHING)
            graph.add_edge(pydot.Edge(nodes[name], box, label=label))
        for name in first.top:
            graph.add_edge(pydot.Edge(box, nodes[name], label=_shape_label(known, name, size)))
    return graph


def _with_layers_in_place(layers: Sequence[Any]) -> list[list[Any]]:
    """The layers, each with those in place on its top that follow it."""
    groups: list[list[Any]] = []
    makers: dict[str, list[Any]] = {}
    for layer in layers:
        group = makers.get(layer.bottom[0]) if _is_in_place(layer) else None
        if group is None:
            groups.append([layer])
            makers.update((name, groups[-1]) for name in layer.top)
        else:
            group.append(layer)
    return groups


def _is_in_place(layer: Any) -> bool:
    return len(layer.bottom) == len(layer.top) == 1 and layer.bottom[0] == layer.top[0]


def _style(layer: Any) -> dict[str, str]:
    """Shape and colour of a box."""
    if _is_in_place(layer):
        return NEURON_LAYER_STYLE
    return {**LAYER_STYLE_DEFAULT, "fillcolor": choose_color_by_layertype(layer.type)}


def _box_label(group: Sequence[Any], rankdir: str, display_lrm: bool) -> str:
    """Label of the box of a layer and those in place on its top, one below the other."""
    labels = [get_layer_label(layer, rankdir, display_lrm)[1:-1] for layer in group]
    return '"' + r"\n".join(labels) + '"'


def _shape_label(shapes: Shapes, name: str, otherwise: str) -> str:
    """Label of an arrow to a blob: its shape, such as 1 x 3 x 224 x 224."""
    return f'"{" x ".join(map(str, shapes[name]))}"' if shapes.get(name) else otherwise


def _is_in(layer: Any, phase: int) -> bool:
    """Whether a layer is in this phase; rules about levels and stages are ignored."""
    if len(layer.include) and len(layer.exclude):
        raise RuleError(f"layer {layer.name!r} has both include and exclude specified.")
    if len(layer.include):
        return any(not rule.HasField("phase") or rule.phase == phase for rule in layer.include)
    return not any(rule.HasField("phase") and rule.phase == phase for rule in layer.exclude)


def _quoted(name: str) -> str:
    """Quote a name for Graphviz unless it is a plain word."""
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) and name.lower() not in _WORDS:
        return name
    return f'"{_escaped(name)}"'


def _escaped(name: str) -> str:
    """Escape a name for use between quotes."""
    return name.replace("\\", "\\\\").replace('"', '\\"')


def draw_net(
    caffe_net: Any,
    rankdir: str,
    ext: str = "png",
    phase: int | None = None,
    display_lrm: bool = False,
    shapes: Shapes | None = None,
) -> bytes:
    """Draw a NetParameter in a format of Graphviz: png, svg, pdf ...; "raw" and "dot" return
    Graphviz's own language, without its program.

    Raises NetlibError, also if pydot or Graphviz is missing.
    """
    graph = get_pydot_graph(caffe_net, rankdir, phase=phase, display_lrm=display_lrm, shapes=shapes)
    text: bytes = graph.to_string().encode("utf-8", "backslashreplace")
    if ext in ("raw", "dot"):
        return text
    program = shutil.which("dot")
    if program is None:
        raise NetlibError(
            f"Graphviz's program dot is missing: install {GRAPHVIZ}; the formats raw and dot do not need it"
        )
    done = subprocess.run([program, f"-T{ext}"], input=text, capture_output=True, check=False)
    if done.returncode:
        why = (
            " ".join(done.stderr.decode(errors="replace").split())
            or f"exit status {done.returncode}"
        )
        raise NetlibError(f"dot cannot draw the net as {ext!r}: {why}")
    return done.stdout


def draw_net_to_file(
    caffe_net: Any,
    filename: str | Path,
    rankdir: str = "LR",
    phase: int | None = None,
    display_lrm: bool = False,
    shapes: Shapes | None = None,
) -> None:
    """Write the image of a NetParameter in the format of the file's suffix. Raises NetlibError."""
    ext = Path(filename).suffix.removeprefix(".")
    if not ext:
        raise NetlibError(
            f"{filename}: no suffix; expected one that names the format: .png, .svg, .pdf ..."
        )
    picture = draw_net(caffe_net, rankdir, ext, phase, display_lrm, shapes)
    with reading.refused(filename, "the image", NetlibError, "write"):
        atomic.replace(Path(filename), lambda file: file.write_bytes(picture))
