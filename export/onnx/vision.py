"""Convolutions, poolings and crops, prior boxes, and the selection of detections, as
ONNX operators.

A public function adds the operators of one layer type (net.py) to the graph, and returns the names
of the values of its tops.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from export.onnx.graph import Graph, LayerCall
from layers.detection.prior_box import prior_boxes
from netlib.blob import Array, divide_up


def sliding(graph: Graph, call: LayerCall, op: str) -> list[str]:
    """Apply Conv or ConvTranspose to every bottom, with the same weights."""
    layer = call.layer
    w = layer.blobs[0].data
    kernel = list(layer.kernel) or [1]  # ONNX needs at least one spatial axis
    options: dict[str, Any] = {"kernel_shape": kernel, "group": layer.param.group}
    if layer.kernel:
        options |= {
            "strides": list(layer.stride),
            "dilations": list(layer.dilation),
            "pads": [*layer.pad, *layer.pad],
        }
    parameters = [graph.constant(w.reshape(*w.shape[:2], *kernel), "weight")]
    if layer.param.bias_term:
        parameters.append(graph.constant(layer.blobs[1].data, "bias"))
    tops = []
    for value, x, y in zip(call.values, call.bottom, call.top):
        has_batch_axis = len(x) == len(kernel) + 2  # (N, C, ...)
        if not has_batch_axis:
            axis = len(x) - len(layer.kernel) - 1
            spatial = () if layer.kernel else (1,)
            value = graph.reshaped(value, ("N", *call.sizes(x[axis:]), *spatial))
        top = graph.op(op, value, *parameters, **options)
        tops.append(top if has_batch_axis else graph.reshaped(top, y))
    return tops


def pooling(graph: Graph, call: LayerCall) -> list[str]:
    """Translate Caffe's pooling: as many windows as the top has, with pads that fit exactly these.

    ONNX's ceil_mode keeps windows that Caffe drops, and its mean counts elements differently. So
    output sizes are rounded down, the end pads fit the last window, and where that window extends
    past Caffe's padding, which Caffe does not count, a constant corrects the mean. A last window
    beyond the image (stride > kernel) has no value and is rejected by the operators, so it is
    appended with Pad.
    """
    layer = call.layer
    is_max = layer.param.pool == "MAX"
    x = call.values[0]
    if layer.param.global_pooling and len(call.top) == 1:
        return [graph.op("GlobalMaxPool" if is_max else "GlobalAveragePool", x)]
    kernel, stride, pad = map(np.array, (layer.kernel, layer.stride, layer.pad))
    sizes, outputs = (np.array(call.sizes(shape[2:])) for shape in (call.bottom[0], call.top[0]))
    inside = np.minimum(outputs, -(-(sizes + pad) // stride))  # windows that begin in the image
    extent = (inside - 1) * stride + kernel
    after = np.maximum(extent - sizes - pad, 0)
    beyond = (outputs - inside).tolist()
    options: dict[str, Any] = {
        "kernel_shape": kernel.tolist(),
        "strides": stride.tolist(),
        "pads": [*pad.tolist(), *after.tolist()],
    }
    if is_max:
        y = graph.ops("MaxPool", len(call.top), x, **options)
        if len(y) > 1:  # ONNX's index counts through all items and channels
            index = graph.op("Mod", y[1], graph.constant(np.prod(sizes), "map"))
            y[1] = _completed(graph, graph.to_float(index), beyond, -1.0)
        return [_completed(graph, y[0], beyond, float(np.finfo(np.float32).min)), *y[1:]]
    mean = graph.op("AveragePool", x, count_include_pad=1, **options)
    mean = _completed(graph, mean, beyond, 0.0)
    with np.errstate(divide="ignore"):  # 0 x infinity is NaN, like Caffe's 0 / 0
        correction = kernel.prod() / _counted(layer, sizes, outputs)
    if (correction != 1).any():
        mean = graph.op("Mul", mean, graph.constant(correction, "correction"))
    return [mean]


def _completed(graph: Graph, y: str, beyond: list[int], nothing: float) -> str:
    """Append the rows and columns of windows beyond the image, with the value ``nothing``."""
    if not any(beyond):
        return y
    pads = graph.constant([0] * 6 + beyond, "beyond")
    return graph.op("Pad", y, pads, graph.constant(nothing, "nothing"))


def _counted(layer: Any, sizes: Array, outputs: Array) -> Array:
    """The numbers of elements (Ho, Wo) by which Caffe's mean divides: those of each window in the
    image (2,) and its padding.
    """
    by_axis = []
    for count, size, k, s, p in zip(outputs, sizes, layer.kernel, layer.stride, layer.pad):
        start = np.arange(count) * s - p
        end = np.minimum(start + k, size + p)
        by_axis.append(end - start)
    return np.outer(*by_axis)


def spp(graph: Graph, call: LayerCall) -> list[str]:
    sizes = call.sizes(call.bottom[0][2:])
    levels = []
    for level in range(call.layer.param.pyramid_height):
        kernel = [divide_up(n, 2**level) for n in sizes]
        missing = [side * 2**level - n for side, n in zip(kernel, sizes)]
        before = [divide_up(n, 2) for n in missing]
        after = [n // 2 for n in missing]
        options: dict[str, Any] = {
            "kernel_shape": kernel,
            "strides": kernel,
            "pads": [*before, *after],
        }
        if call.layer.param.pool == "MAX":
            levels.append(graph.op("MaxPool", call.values[0], **options))
        else:
            levels.append(graph.op("AveragePool", call.values[0], count_include_pad=1, **options))
    if len(levels) == 1:
        return levels
    rows = [graph.op("Flatten", level, axis=1) for level in levels]
    return [graph.op("Concat", *rows, axis=1)]


def crop(graph: Graph, call: LayerCall) -> list[str]:
    x, y, parts = call.bottom[0], call.top[0], call.layer.part
    axes = [i for i, part in enumerate(parts) if part != slice(None) and x[i] != y[i]]
    sizes = call.sizes(tuple(y[i] for i in axes))
    starts = [parts[i].start for i in axes]
    ends = [start + size for start, size in zip(starts, sizes)]
    if not axes:
        return call.values[:1]
    return [graph.sliced(call.values[0], starts, ends, axes)]


def interp(graph: Graph, call: LayerCall) -> list[str]:
    top_sizes = call.sizes(call.top[0][2:])
    y, inside = call.values[0], call.layer.inside[1:]
    starts, stops = [part.start for part in inside], [part.stop for part in inside]
    p = call.layer.param
    if p.pad_beg or p.pad_end:
        y = graph.sliced(y, starts, stops, [2, 3])
    if [part.stop - part.start for part in inside] == top_sizes:
        return [y]
    size = graph.constant(call.sizes(call.bottom[0][1:2]) + top_sizes, "size")
    sizes = graph.op("Concat", graph.shape_of(y, 0, 1), size, axis=0)
    y = graph.op(
        "Resize", y, "", "", sizes, mode="linear", coordinate_transformation_mode="align_corners"
    )
    return [y]


def upsample(graph: Graph, call: LayerCall) -> list[str]:
    """Translate Upsample; with a mask, scatter the values in each map, because MaxUnpool's indices
    count through the batch.
    """
    if len(call.values) == 1:
        factors = [1.0] * (len(call.bottom[0]) - 2) + [float(call.layer.scale)] * 2
        scales = graph.constant(factors, "scales")
        y = graph.op(
            "Resize",
            call.values[0],
            "",
            scales,
            mode="nearest",
            coordinate_transformation_mode="asymmetric",
            nearest_mode="floor",
        )
        return [y]
    C, H, W = call.sizes(call.bottom[0][1:])
    Ho, Wo = call.sizes(call.top[0][2:])
    x, mask = (graph.reshaped(value, ("N", C, H * W)) for value in call.values)
    shape = graph.op("Concat", graph.shape_of(x, 0, 2), graph.constant([Ho * Wo], "size"), axis=0)
    zeros = graph.op("Expand", graph.constant(0.0, "zero"), shape)
    y = graph.op("ScatterElements", zeros, graph.to_int(mask), x, axis=2)
    return [graph.reshaped(y, call.top[0])]


def prior_box(graph: Graph, call: LayerCall) -> list[str]:
    """Translate the boxes to a constant: they depend on sizes only, which an ONNX file fixes."""
    H, W = call.sizes(call.bottom[0][2:])
    image = call.layer.image or tuple(call.sizes(call.bottom[1][2:]))
    boxes = np.stack(prior_boxes(call.layer.param, (H, W), image, call.layer.step))
    return [graph.constant(boxes.reshape(1, 2, -1), "priors")]


def detection_output(graph: Graph, call: LayerCall) -> list[str]:
    """Translate the selection with N items, P priors, C classes, of which L have labels other than
    the background's, and the B best candidates of each label.

    NonMaxSuppression has one set of boxes for all classes and no limit of its candidates, so it is
    given N L items of one class with B boxes. What it selects is written as a flag for each of the
    N x (L B) candidates, which are sorted by label and confidence. The flags that are set, in this
    order, are the rows.
    """
    layer = call.layer
    p, P, C = layer.param, layer.prior_count, layer.param.num_classes
    labels = [label for label in range(C) if label != p.background_label_id]
    L = len(labels)
    B = min(P, p.nms_param.top_k) if p.nms_param.top_k >= 0 else P
    if p.nms_param.eta < 1:
        raise layer.fail(
            "eta below 1 cannot be exported to ONNX; expected eta: 1 or no value", "nms_param"
        )
    if not labels or not B or p.keep_top_k == 0:
        raise layer.fail(
            "has no detections: no class except the background, or top_k or keep_top_k of 0"
        )
    by_class = graph.op("Transpose", graph.reshaped(call.values[1], ("N", P, C)), perm=[0, 2, 1])
    by_label = _of_labels(graph, by_class, labels, C)
    scores, best = graph.ops("TopK", 2, by_label, graph.constant([B], "k"), axis=2)
    scores = graph.reshaped(scores, ("N", L * B))
    boxes = graph.reshaped(_boxes(graph, call, labels, best, B), ("N", L * B, 4))
    flags = _not_suppressed(graph, call, boxes, scores, L, B)
    if 0 < p.keep_top_k < L * B:
        flags = _best_only(graph, flags, scores, p.keep_top_k)
    call.top[0] = (1, 1, "detections", 7)
    rows = _rows(graph, flags, boxes, scores, labels, B)
    rows = graph.op("Concat", rows, _no_rows(graph, flags), axis=0)
    return [graph.op("Unsqueeze", rows, graph.constant([0, 1], "axes"))]


def _best_only(graph: Graph, flags: str, scores: str, count: int) -> str:
    """Keep the flags (N, L B) of the ``count`` best candidates of each item that have one."""
    lowest = graph.constant(float(np.finfo(np.float32).min), "lowest")
    ranked = graph.op("Where", graph.op("Cast", flags, to=9), scores, lowest)  # BOOL
    _, first = graph.ops("TopK", 2, ranked, graph.constant([count], "keep"), axis=1)
    kept = graph.op("GatherElements", flags, first, axis=1)
    return graph.op("ScatterElements", _zeros_like(graph, flags), first, kept, axis=1)


def _of_labels(graph: Graph, value: str, labels: list[int], classes: int) -> str:
    """Select the labels from axis 1."""
    if len(labels) == classes:
        return value
    return graph.op("Gather", value, graph.constant(labels, "labels"), axis=1)


def _boxes(graph: Graph, call: LayerCall, labels: list[int], best: str, B: int) -> str:
    """Decode all locations and select those of the candidates: N L B boxes."""
    p, P, C = call.layer.param, call.layer.prior_count, call.layer.param.num_classes
    both = graph.reshaped(call.values[2], (2, P, 4))
    prior, variance = (graph.op("Gather", both, graph.constant(i, "index"), axis=0) for i in (0, 1))
    if p.share_location:
        change = graph.reshaped(call.values[0], ("N", P, 4))
        index = graph.reshaped(best, ("N", len(labels) * B, 1))
    else:
        change = graph.reshaped(call.values[0], ("N", P, C, 4))
        change = graph.op("Transpose", change, perm=[0, 2, 1, 3])
        change = _of_labels(graph, change, labels, C)
        index = graph.reshaped(best, ("N", len(labels), B, 1))
    if not p.variance_encoded_in_target:
        change = graph.op("Mul", change, variance)
    boxes = _decoded(graph, p.code_type, prior, change)
    if p.clip:
        boxes = graph.op("Clip", boxes, graph.constant(0.0, "min"), graph.constant(1.0, "max"))
    return graph.op("GatherND", boxes, index, batch_dims=1 if p.share_location else 2)


def _decoded(graph: Graph, code_type: str, prior: str, change: str) -> str:
    """Apply changes (..., P, 4) to the prior boxes (P, 4), by the code of their layer."""
    first, last = _halves(graph, prior)
    size = graph.op("Sub", last, first)
    if code_type == "CENTER_SIZE":
        shift, log_scale = _halves(graph, change)
        centre = graph.affine(graph.op("Add", first, last), 0.5, 0)
        centre = graph.op("Add", centre, graph.op("Mul", shift, size))
        half = graph.affine(graph.op("Mul", size, graph.op("Exp", log_scale)), 0.5, 0)
        corners = graph.op("Sub", centre, half), graph.op("Add", centre, half)
        return graph.op("Concat", *corners, axis=-1)
    if code_type == "CORNER_SIZE":
        change = graph.op("Mul", change, graph.op("Concat", size, size, axis=-1))
    return graph.op("Add", prior, change)


def _halves(graph: Graph, boxes: str) -> list[str]:
    """Split the last axis of 4 in two."""
    return graph.ops("Split", 2, boxes, graph.constant([2, 2], "parts"), axis=-1)


def _not_suppressed(graph: Graph, call: LayerCall, boxes: str, scores: str, L: int, B: int) -> str:
    """Flags (N, L B): 1 for what non-maximum suppression keeps, else 0."""
    p: Any = call.layer.param
    # an inverted box overlaps none here, but ONNX would exchange its corners
    if p.code_type != "CENTER_SIZE":
        first, last = _halves(graph, boxes)
        boxes = graph.op("Concat", first, graph.op("Max", first, last), axis=-1)
    max_overlap = min(p.nms_param.nms_threshold, 1.0)
    limits = [graph.constant([B], "k"), graph.constant([max_overlap], "overlap")]
    if p.confidence_threshold is not None:
        limits.append(graph.constant([p.confidence_threshold], "threshold"))
    by_label = graph.reshaped(boxes, ("N", B, 4)), graph.reshaped(scores, ("N", 1, B))
    chosen = graph.op("NonMaxSuppression", *by_label, *limits)
    # (item, candidate) of each row (item, class, candidate)
    indices = graph.op("Gather", chosen, graph.constant([0, 2], "columns"), axis=1)
    count = graph.shape_of(indices, 0, 1)
    ones = graph.op("Expand", graph.constant([1.0], "one"), count)
    zeros = _zeros_like(graph, graph.reshaped(scores, ("N", B)))
    flags = graph.op("ScatterND", zeros, indices, ones)
    return graph.reshaped(flags, ("N", L * B))


def _zeros_like(graph: Graph, value: str) -> str:
    return graph.op("Expand", graph.constant([0.0], "nought"), graph.op("Shape", value))


def _rows(graph: Graph, flags: str, boxes: str, scores: str, labels: list[int], B: int) -> str:
    """The rows (D, 7) of all flags that are set."""
    indices = graph.op("Transpose", graph.op("NonZero", flags), perm=[1, 0])
    item, candidate = (
        graph.op("Gather", indices, graph.constant([i], "column"), axis=1) for i in (0, 1)
    )
    all_labels = graph.constant(np.repeat(labels, B).astype(float), "labels")
    label = graph.op("Gather", all_labels, candidate, axis=0)
    score = graph.reshaped(graph.op("GatherND", scores, indices), ("D", 1))
    columns = graph.to_float(item), label, score, graph.op("GatherND", boxes, indices)
    return graph.op("Concat", *columns, axis=1)


def _no_rows(graph: Graph, flags: str) -> str:
    """For a batch without detections a row for each item, -1 behind its number; otherwise none."""
    count = graph.shape_of(flags, 0, 1)
    items = graph.op(
        "Range", graph.constant(0, "first"), graph.op("Squeeze", count), graph.constant(1, "step")
    )
    items = graph.reshaped(graph.to_float(items), ("N", 1))
    pads = graph.constant([0, 0, 0, 6], "pads")
    rows = graph.op("Pad", items, pads, graph.constant(-1.0, "nothing"))
    total = graph.op("ReduceSum", flags, keepdims=0)
    is_empty = graph.to_int(graph.op("Equal", total, graph.constant(0.0, "zero")))
    row_count = graph.op("Mul", count, is_empty)  # N or 0
    return graph.op("Slice", rows, graph.constant([0], "start"), row_count)
