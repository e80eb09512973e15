"""Convolutions, poolings and crops, prior boxes, and the selection of detections, as
ONNX operators.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from export.onnx.graph import Graph, Place
from layers.detection.prior_box import prior_boxes


def sliding(graph: Graph, at: Place, op: str) -> list[str]:
    """Apply Conv or ConvTranspose to every bottom, with the same weights."""
    layer = at.layer
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
    for value, x, y in zip(at.values, at.bottom, at.top):
        plain = len(x) == len(kernel) + 2
        if not plain:  # axes other than (N, C, ...)
            axis = len(x) - len(layer.kernel) - 1
            value = graph.reshaped(
                value, ("N", *at.sizes(x[axis:]), *([] if layer.kernel else [1]))
            )
        out = graph.op(op, value, *parameters, **options)
        tops.append(out if plain else graph.reshaped(out, y))
    return tops


def pooling(graph: Graph, at: Place) -> list[str]:
    """Translate Caffe's pooling: as many windows as the top has, with pads that fit exactly these.

    ONNX's ceil_mode keeps windows that Caffe drops, and its mean counts elements differently. So
    output sizes are rounded down, the end pads fit the last window, and where that window extends
    past Caffe's padding, which Caffe does not count, a constant corrects the mean. A last window
    beyond the image (stride > kernel) has no value and is rejected by the operators, so it is
    appended with Pad.
    """
    layer = at.layer
    is_max, x = layer.param.pool == "MAX", at.values[0]
    if layer.param.global_pooling and len(at.top) == 1:
        return [graph.op("GlobalMaxPool" if is_max else "GlobalAveragePool", x)]
    axes = list(zip(at.sizes(at.bottom[0][2:]), layer.kernel, layer.stride, layer.pad))
    outputs = at.sizes(at.top[0][2:])
    inside, after = [], []
    for output, (n, kernel, stride, pad) in zip(outputs, axes):
        starting_inside = -(-(n + pad) // stride)
        inside.append(min(output, starting_inside))
        extent = (inside[-1] - 1) * stride + kernel  # of these windows
        after.append(max(extent - n - pad, 0))
    options: dict[str, Any] = {
        "kernel_shape": list(layer.kernel),
        "strides": list(layer.stride),
        "pads": [*layer.pad, *after],
    }
    beyond = [o - i for o, i in zip(outputs, inside)]

    def completed(y: str, nothing: float) -> str:
        if not any(beyond):
            return y
        return graph.op(
            "Pad", y, graph.constant([0] * 6 + beyond, "beyond"), graph.constant(nothing, "nothing")
        )

    if is_max:
        y = graph.ops("MaxPool", len(at.top), x, **options)
        if len(y) > 1:  # ONNX's index counts through all items and channels
            place = graph.op("Mod", y[1], graph.constant(math.prod(n for n, *_ in axes), "map"))
            y[1] = completed(graph.floats(place), -1.0)
        return [completed(y[0], float(np.finfo(np.float32).min)), *y[1:]]
    mean = completed(graph.op("AveragePool", x, count_include_pad=1, **options), 0.0)
    counted = []
    for output, (n, kernel, stride, pad) in zip(outputs, axes):
        start = np.arange(output) * stride - pad
        end = np.minimum(start + kernel, n + pad)
        counted.append(end - start)
    with np.errstate(divide="ignore"):
        # 0 x infinity is NaN, like Caffe's 0 / 0
        correction = math.prod(layer.kernel) / np.outer(*counted)
    return [
        mean
        if (correction == 1).all()
        else graph.op("Mul", mean, graph.constant(correction, "correction"))
    ]


def spp(graph: Graph, at: Place) -> list[str]:
    sizes, levels = at.sizes(at.bottom[0][2:]), []
    for level in range(at.layer.param.pyramid_height):
        kernel = [-(-n // 2**level) for n in sizes]
        missing = [side * 2**level - n for side, n in zip(kernel, sizes)]
        before = [(m + 1) // 2 for m in missing]
        options: dict[str, Any] = {
            "kernel_shape": kernel,
            "strides": kernel,
            "pads": [*before, *(m - b for m, b in zip(missing, before))],
        }
        if at.layer.param.pool == "MAX":
            levels.append(graph.op("MaxPool", at.values[0], **options))
        else:
            levels.append(graph.op("AveragePool", at.values[0], count_include_pad=1, **options))
    if len(levels) == 1:
        return levels
    return [graph.op("Concat", *(graph.op("Flatten", level, axis=1) for level in levels), axis=1)]


def crop(graph: Graph, at: Place) -> list[str]:
    x, y, parts = at.bottom[0], at.top[0], at.layer.part
    axes = [i for i, part in enumerate(parts) if part != slice(None) and x[i] != y[i]]
    sizes = at.sizes(tuple(y[i] for i in axes))
    starts = [parts[i].start for i in axes]
    ends = [start + size for start, size in zip(starts, sizes)]
    if not axes:
        return at.values[:1]
    return [graph.sliced(at.values[0], starts, ends, axes)]


def interp(graph: Graph, at: Place) -> list[str]:
    x, y = at.bottom[0], at.top[0]
    value, cut = at.values[0], at.layer.inside[1:]
    if (at.layer.param.pad_beg, at.layer.param.pad_end) != (0, 0):
        value = graph.sliced(
            value, [part.start for part in cut], [part.stop for part in cut], [2, 3]
        )
    if [part.stop - part.start for part in cut] == at.sizes(y[2:]):
        return [value]
    size = graph.constant([*at.sizes(x[1:2]), *at.sizes(y[2:])], "size")
    sizes = graph.op("Concat", graph.sizes(value, 0, 1), size, axis=0)
    options = {"mode": "linear", "coordinate_transformation_mode": "align_corners"}
    return [graph.op("Resize", value, "", "", sizes, **options)]


def upsample(graph: Graph, at: Place) -> list[str]:
    """Translate Upsample; with a mask, scatter the values in each map, because MaxUnpool's indices
    count through the batch.
    """
    if len(at.values) == 1:
        factors = [1.0] * (len(at.bottom[0]) - 2) + [float(at.layer.scale)] * 2
        scales = graph.constant(factors, "scales")
        options = {
            "mode": "nearest",
            "coordinate_transformation_mode": "asymmetric",
            "nearest_mode": "floor",
        }
        return [graph.op("Resize", at.values[0], "", scales, **options)]
    C, H, W = at.sizes(at.bottom[0][1:])
    Ho, Wo = at.sizes(at.top[0][2:])
    x, mask = (graph.reshaped(value, ("N", C, H * W)) for value in at.values)
    shape = graph.op("Concat", graph.sizes(x, 0, 2), graph.constant([Ho * Wo], "size"), axis=0)
    zeros = graph.op("Expand", graph.constant(0.0, "zero"), shape)
    y = graph.op("ScatterElements", zeros, graph.whole(mask), x, axis=2)
    return [graph.reshaped(y, at.top[0])]


def prior_box(graph: Graph, at: Place) -> list[str]:
    """Translate the boxes to a constant: they depend on sizes only, which an ONNX file fixes."""
    H, W = at.sizes(at.bottom[0][2:])
    image = at.layer.image or tuple(at.sizes(at.bottom[1][2:]))
    boxes = np.stack(prior_boxes(at.layer.param, (H, W), image, at.layer.step))
    return [graph.constant(boxes.reshape(1, 2, -1), "priors")]


def detection_output(graph: Graph, at: Place) -> list[str]:
    """Translate the selection with N items, P priors, C classes, of which L have labels other than
    the background's, and the B best candidates of each label.

    NonMaxSuppression has one set of boxes for all classes and no limit of its candidates, so it is
    given N L items of one class with B boxes. What it selects is written as a flag for each of the
    N x (L B) candidates, which are sorted by label and confidence. The flags that are set, in this
    order, are the rows.
    """
    layer = at.layer
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
    by_class = graph.op("Transpose", graph.reshaped(at.values[1], ("N", P, C)), perm=[0, 2, 1])
    scores, best = graph.ops(
        "TopK", 2, _of_labels(graph, by_class, labels, C), graph.constant([B], "k"), axis=2
    )
    scores = graph.reshaped(scores, ("N", L * B))
    boxes = graph.reshaped(_boxes(graph, at, labels, best, B), ("N", L * B, 4))
    flags = _not_suppressed(graph, at, boxes, scores, L, B)
    if 0 < p.keep_top_k < L * B:
        lowest = graph.constant(float(np.finfo(np.float32).min), "lowest")
        ranked = graph.op("Where", graph.op("Cast", flags, to=9), scores, lowest)  # BOOL
        _, first = graph.ops("TopK", 2, ranked, graph.constant([p.keep_top_k], "keep"), axis=1)
        kept = graph.op("GatherElements", flags, first, axis=1)
        flags = graph.op("ScatterElements", _zeros_like(graph, flags), first, kept, axis=1)
    at.top[0] = (1, 1, "detections", 7)
    rows = graph.op(
        "Concat", _rows(graph, flags, boxes, scores, labels, B), _no_rows(graph, flags), axis=0
    )
    return [graph.op("Unsqueeze", rows, graph.constant([0, 1], "axes"))]


def _of_labels(graph: Graph, value: str, labels: list[int], classes: int) -> str:
    """Select the labels from axis 1."""
    return (
        value
        if len(labels) == classes
        else graph.op("Gather", value, graph.constant(labels, "labels"), axis=1)
    )


def _boxes(graph: Graph, at: Place, labels: list[int], best: str, B: int) -> str:
    """Decode all locations and select those of the candidates: N L B boxes."""
    p, P, C = at.layer.param, at.layer.prior_count, at.layer.param.num_classes
    both = graph.reshaped(at.values[2], (2, P, 4))
    prior, variance = (graph.op("Gather", both, graph.constant(i, "index"), axis=0) for i in (0, 1))
    if p.share_location:
        change = graph.reshaped(at.values[0], ("N", P, 4))
        index = graph.reshaped(best, ("N", len(labels) * B, 1))
    else:
        change = graph.op(
            "Transpose", graph.reshaped(at.values[0], ("N", P, C, 4)), perm=[0, 2, 1, 3]
        )
        change = _of_labels(graph, change, labels, C)
        index = graph.reshaped(best, ("N", len(labels), B, 1))
    if not p.variance_encoded_in_target:
        change = graph.op("Mul", change, variance)
    first, last = _halves(graph, prior)
    size = graph.op("Sub", last, first)
    if p.code_type == "CENTER_SIZE":
        shift, log_scale = _halves(graph, change)
        centre = graph.affine(graph.op("Add", first, last), 0.5, 0)
        centre = graph.op("Add", centre, graph.op("Mul", shift, size))
        half = graph.affine(graph.op("Mul", size, graph.op("Exp", log_scale)), 0.5, 0)
        boxes = graph.op(
            "Concat", graph.op("Sub", centre, half), graph.op("Add", centre, half), axis=-1
        )
    else:
        if p.code_type == "CORNER_SIZE":
            change = graph.op("Mul", change, graph.op("Concat", size, size, axis=-1))
        boxes = graph.op("Add", prior, change)
    if p.clip:
        boxes = graph.op("Clip", boxes, graph.constant(0.0, "min"), graph.constant(1.0, "max"))
    return graph.op("GatherND", boxes, index, batch_dims=1 if p.share_location else 2)


def _halves(graph: Graph, boxes: str) -> list[str]:
    """Split the last axis of 4 in two."""
    return graph.ops("Split", 2, boxes, graph.constant([2, 2], "parts"), axis=-1)


def _not_suppressed(graph: Graph, at: Place, boxes: str, scores: str, L: int, B: int) -> str:
    """Flags (N, L B): 1 for what non-maximum suppression keeps, else 0."""
    p: Any = at.layer.param
    # an inverted box overlaps none here, but ONNX would exchange its corners
    if p.code_type != "CENTER_SIZE":
        first, last = _halves(graph, boxes)
        boxes = graph.op("Concat", first, graph.op("Max", first, last), axis=-1)
    limits = [
        graph.constant([B], "k"),
        graph.constant([min(p.nms_param.nms_threshold, 1.0)], "overlap"),
    ]
    if p.confidence_threshold is not None:
        limits.append(graph.constant([p.confidence_threshold], "threshold"))
    chosen = graph.op(
        "NonMaxSuppression",
        graph.reshaped(boxes, ("N", B, 4)),
        graph.reshaped(scores, ("N", 1, B)),
        *limits,
    )
    # item, candidate
    places = graph.op("Gather", chosen, graph.constant([0, 2], "columns"), axis=1)
    count = graph.sizes(places, 0, 1)
    ones = graph.op("Expand", graph.constant([1.0], "one"), count)
    flags = graph.op(
        "ScatterND", _zeros_like(graph, graph.reshaped(scores, ("N", B))), places, ones
    )
    return graph.reshaped(flags, ("N", L * B))


def _zeros_like(graph: Graph, value: str) -> str:
    return graph.op("Expand", graph.constant([0.0], "nought"), graph.op("Shape", value))


def _rows(graph: Graph, flags: str, boxes: str, scores: str, labels: list[int], B: int) -> str:
    """The rows (D, 7) of all flags that are set."""
    places = graph.op("Transpose", graph.op("NonZero", flags), perm=[1, 0])
    item, candidate = (
        graph.op("Gather", places, graph.constant([i], "column"), axis=1) for i in (0, 1)
    )
    label = graph.op(
        "Gather", graph.constant(np.repeat(labels, B).astype(float), "labels"), candidate, axis=0
    )
    score = graph.reshaped(graph.op("GatherND", scores, places), ("D", 1))
    return graph.op(
        "Concat", graph.floats(item), label, score, graph.op("GatherND", boxes, places), axis=1
    )


def _no_rows(graph: Graph, flags: str) -> str:
    """For a batch without detections a row for each item, -1 behind its number; otherwise none."""
    count = graph.sizes(flags, 0, 1)
    limits = [graph.constant(0, "first"), graph.op("Squeeze", count), graph.constant(1, "step")]
    items = graph.reshaped(graph.floats(graph.op("Range", *limits)), ("N", 1))
    rows = graph.op(
        "Pad", items, graph.constant([0, 0, 0, 6], "pads"), graph.constant(-1.0, "nothing")
    )
    none = graph.whole(
        graph.op("Equal", graph.op("ReduceSum", flags, keepdims=0), graph.constant(0.0, "zero"))
    )
    # of N rows all or none
    return graph.op("Slice", rows, graph.constant([0], "start"), graph.op("Mul", count, none))
