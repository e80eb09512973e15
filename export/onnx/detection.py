"""Prior boxes, and the selection of detections, as ONNX operators."""

from __future__ import annotations

from typing import Any

import numpy as np

from export.onnx.graph import Graph, Place
from layers.detection.prior_box import prior_boxes


def prior_box(graph: Graph, at: Place) -> list[str]:
    """Translate the boxes to a constant: they depend on sizes only, which an ONNX file fixes."""
    layer: Any = at.layer
    H, W = at.sizes(at.bottom[0][2:])
    image = layer.image or tuple(at.sizes(at.bottom[1][2:]))
    boxes = np.stack(prior_boxes(layer.param, (H, W), image, layer.step))
    return [graph.constant(boxes.reshape(1, 2, -1), "priors")]


def detection_output(graph: Graph, at: Place) -> list[str]:
    """Translate the selection with N items, K classes without the background and their k best candidates.

    NonMaxSuppression has one set of boxes for all classes and no limit of its candidates, so it is given N K items of
    one class with k boxes. What it selects is written as a flag for each of the N x (K k) candidates, which are sorted
    by label and confidence. The flags that are set, in this order, are the rows.
    """
    layer: Any = at.layer
    p, P, C = layer.param, layer.priors, layer.param.num_classes
    labels = [label for label in range(C) if label != p.background_label_id]
    k = min(P, p.nms_param.top_k) if p.nms_param.top_k >= 0 else P
    if p.nms_param.eta < 1:
        raise layer.fail("eta below 1 cannot be exported to ONNX; expected eta: 1 or no value", "nms_param")
    if not labels or not k or p.keep_top_k == 0:
        raise layer.fail("has no detections: no class except the background, or top_k or keep_top_k of 0")
    K = len(labels)
    by_class = graph.op("Transpose", graph.reshaped(at.values[1], ("N", P, C)), perm=[0, 2, 1])
    scores, best = graph.ops("TopK", 2, _of_labels(graph, by_class, labels, C), graph.constant([k], "k"), axis=2)
    scores = graph.reshaped(scores, ("N", K * k))
    boxes = graph.reshaped(_boxes(graph, at, labels, best, k), ("N", K * k, 4))
    flags = _not_suppressed(graph, at, boxes, scores, K, k)
    if 0 < p.keep_top_k < K * k:
        lowest = graph.constant(float(np.finfo(np.float32).min), "lowest")
        ranked = graph.op("Where", graph.op("Cast", flags, to=9), scores, lowest)  # BOOL
        _, first = graph.ops("TopK", 2, ranked, graph.constant([p.keep_top_k], "keep"), axis=1)
        kept = graph.op("GatherElements", flags, first, axis=1)
        flags = graph.op("ScatterElements", _zeros_like(graph, flags), first, kept, axis=1)
    at.top[0] = (1, 1, "detections", 7)
    rows = graph.op("Concat", _rows(graph, flags, boxes, scores, labels, k), _no_rows(graph, flags), axis=0)
    return [graph.op("Unsqueeze", rows, graph.constant([0, 1], "axes"))]


def _of_labels(graph: Graph, value: str, labels: list[int], classes: int) -> str:
    """Select the labels from axis 1."""
    return value if len(labels) == classes else graph.op("Gather", value, graph.constant(labels, "labels"), axis=1)


def _boxes(graph: Graph, at: Place, labels: list[int], best: str, k: int) -> str:
    """Decode all locations and select those of the candidates: N K k boxes."""
    layer: Any = at.layer
    p, P, C = layer.param, layer.priors, layer.param.num_classes
    both = graph.reshaped(at.values[2], (2, P, 4))
    prior, variance = (graph.op("Gather", both, graph.constant(i, "index"), axis=0) for i in (0, 1))
    if p.share_location:
        change = graph.reshaped(at.values[0], ("N", P, 4))
        index = graph.reshaped(best, ("N", len(labels) * k, 1))
    else:
        change = graph.op("Transpose", graph.reshaped(at.values[0], ("N", P, C, 4)), perm=[0, 2, 1, 3])
        change = _of_labels(graph, change, labels, C)
        index = graph.reshaped(best, ("N", len(labels), k, 1))
    if not p.variance_encoded_in_target:
        change = graph.op("Mul", change, variance)
    first, last = _halves(graph, prior)
    size = graph.op("Sub", last, first)
    if p.code_type == "CENTER_SIZE":
        shift, log_scale = _halves(graph, change)
        centre = graph.affine(graph.op("Add", first, last), 0.5, 0)
        centre = graph.op("Add", centre, graph.op("Mul", shift, size))
        half = graph.affine(graph.op("Mul", size, graph.op("Exp", log_scale)), 0.5, 0)
        boxes = graph.op("Concat", graph.op("Sub", centre, half), graph.op("Add", centre, half), axis=-1)
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


def _not_suppressed(graph: Graph, at: Place, boxes: str, scores: str, K: int, k: int) -> str:
    """Flags (N, K k): 1 for what non-maximum suppression keeps, else 0."""
    p: Any = at.layer.param
    if p.code_type != "CENTER_SIZE":  # an inverted box overlaps none here, but ONNX would exchange its corners
        first, last = _halves(graph, boxes)
        boxes = graph.op("Concat", first, graph.op("Max", first, last), axis=-1)
    limits = [graph.constant([k], "k"), graph.constant([min(p.nms_param.nms_threshold, 1.0)], "overlap")]
    if p.confidence_threshold is not None:
        limits.append(graph.constant([p.confidence_threshold], "threshold"))
    chosen = graph.op("NonMaxSuppression", graph.reshaped(boxes, ("N", k, 4)),
                      graph.reshaped(scores, ("N", 1, k)), *limits)
    places = graph.op("Gather", chosen, graph.constant([0, 2], "columns"), axis=1)  # item, candidate
    count = graph.op("Shape", places, end=1)
    ones = graph.op("Expand", graph.constant([1.0], "one"), count)
    flags = graph.op("ScatterND", _zeros_like(graph, graph.reshaped(scores, ("N", k))), places, ones)
    return graph.reshaped(flags, ("N", K * k))


def _zeros_like(graph: Graph, value: str) -> str:
    return graph.op("Expand", graph.constant([0.0], "nought"), graph.op("Shape", value))


def _rows(graph: Graph, flags: str, boxes: str, scores: str, labels: list[int], k: int) -> str:
    """The rows (D, 7) of all flags that are set."""
    places = graph.op("Transpose", graph.op("NonZero", flags), perm=[1, 0])
    item, candidate = (graph.op("Gather", places, graph.constant([i], "column"), axis=1) for i in (0, 1))
    label = graph.op("Gather", graph.constant(np.repeat(labels, k).astype(float), "labels"), candidate, axis=0)
    score = graph.reshaped(graph.op("GatherND", scores, places), ("D", 1))
    return graph.op("Concat", graph.floats(item), label, score, graph.op("GatherND", boxes, places), axis=1)


def _no_rows(graph: Graph, flags: str) -> str:
    """For a batch without detections a row for each item, -1 behind its number; otherwise none."""
    count = graph.op("Shape", flags, end=1)
    limits = [graph.constant(0, "first"), graph.op("Squeeze", count), graph.constant(1, "step")]
    items = graph.reshaped(graph.floats(graph.op("Range", *limits)), ("N", 1))
    rows = graph.op("Pad", items, graph.constant([0, 0, 0, 6], "pads"), graph.constant(-1.0, "nothing"))
    none = graph.whole(graph.op("Equal", graph.op("ReduceSum", flags, keepdims=0), graph.constant(0.0, "zero")))
    return graph.op("Slice", rows, graph.constant([0], "start"), graph.op("Mul", count, none))  # of N rows all or none
