"""Convolutions, poolings and crops as ONNX operators."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from export.onnx.graph import Graph, Place


def convolution(graph: Graph, at: Place) -> list[str]:
    return _sliding(graph, at, "Conv")


def deconvolution(graph: Graph, at: Place) -> list[str]:
    return _sliding(graph, at, "ConvTranspose")


def _sliding(graph: Graph, at: Place, op: str) -> list[str]:
    """Apply Conv or ConvTranspose to every bottom, with the same weights."""
    layer: Any = at.layer
    w = layer.blobs[0].data
    kernel = list(layer.kernel) or [1]  # ONNX needs at least one spatial axis
    options: dict[str, Any] = {"kernel_shape": kernel, "group": layer.param.group}
    if layer.kernel:
        options |= {"strides": list(layer.stride), "dilations": list(layer.dilation), "pads": [*layer.pad, *layer.pad]}
    parameters = [graph.constant(w.reshape(*w.shape[:2], *kernel), "weight")]
    if layer.param.bias_term:
        parameters.append(graph.constant(layer.blobs[1].data, "bias"))
    tops = []
    for value, x, y in zip(at.values, at.bottom, at.top):
        plain = len(x) == len(kernel) + 2
        if not plain:  # axes other than (N, C, ...)
            axis = len(x) - len(layer.kernel) - 1
            value = graph.reshaped(value, ("N", *at.sizes(x[axis:]), *([] if layer.kernel else [1])))
        out = graph.op(op, value, *parameters, **options)
        tops.append(out if plain else graph.reshaped(out, y))
    return tops


def pooling(graph: Graph, at: Place) -> list[str]:
    """Translate Caffe's pooling: as many windows as the top has, with pads that fit exactly these.

    ONNX's ceil_mode keeps windows that Caffe drops, and its mean counts elements differently. So output sizes are
    rounded down, the end pads fit the last window, and where that window extends past Caffe's padding, which Caffe does
    not count, a constant corrects the mean. A last window beyond the image (stride > kernel) has no value and is
    rejected by the operators, so it is appended with Pad.
    """
    layer: Any = at.layer
    is_max, x = layer.param.pool == "MAX", at.values[0]
    if layer.param.global_pooling and len(at.top) == 1:
        return [graph.op("GlobalMaxPool" if is_max else "GlobalAveragePool", x)]
    axes = list(zip(at.sizes(at.bottom[0][2:]), layer.kernel, layer.stride, layer.pad))
    outputs = at.sizes(at.top[0][2:])
    inside = [min(o, -(-(n + p) // s)) for o, (n, _, s, p) in zip(outputs, axes)]
    after = [max((o - 1) * s + k - n - p, 0) for o, (n, k, s, p) in zip(inside, axes)]
    options: dict[str, Any] = {"kernel_shape": list(layer.kernel), "strides": list(layer.stride),
                               "pads": [*layer.pad, *after]}
    beyond = [o - i for o, i in zip(outputs, inside)]

    def completed(y: str, nothing: float) -> str:
        if not any(beyond):
            return y
        return graph.op("Pad", y, graph.constant([0] * 6 + beyond, "beyond"), graph.constant(nothing, "nothing"))

    if is_max:
        y = graph.ops("MaxPool", len(at.top), x, **options)
        if len(y) > 1:  # ONNX's index counts through all items and channels
            place = graph.op("Mod", y[1], graph.constant(math.prod(n for n, *_ in axes), "map"))
            y[1] = completed(graph.floats(place), -1.0)
        return [completed(y[0], float(np.finfo(np.float32).min)), *y[1:]]
    mean = completed(graph.op("AveragePool", x, count_include_pad=1, **options), 0.0)
    starts = [np.arange(o) * s - p for o, (_, _, s, p) in zip(outputs, axes)]
    counted = [np.minimum(start + k, n + p) - start for start, (n, k, _, p) in zip(starts, axes)]
    with np.errstate(divide="ignore"):
        correction = math.prod(layer.kernel) / np.outer(*counted)  # 0 x infinity is NaN, like Caffe's 0 / 0
    return [mean if (correction == 1).all() else graph.op("Mul", mean, graph.constant(correction, "correction"))]


def spp(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    sizes, levels = at.sizes(at.bottom[0][2:]), []
    for level in range(layer.param.pyramid_height):
        kernel = [-(-n // 2**level) for n in sizes]
        missing = [k * 2**level - n for k, n in zip(kernel, sizes)]
        before = [(m + 1) // 2 for m in missing]
        options: dict[str, Any] = {"kernel_shape": kernel, "strides": kernel,
                                   "pads": [*before, *(m - b for m, b in zip(missing, before))]}
        if layer.param.pool == "MAX":
            levels.append(graph.op("MaxPool", at.values[0], **options))
        else:
            levels.append(graph.op("AveragePool", at.values[0], count_include_pad=1, **options))
    if len(levels) == 1:
        return levels
    return [graph.op("Concat", *(graph.op("Flatten", level, axis=1) for level in levels), axis=1)]


def crop(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    axes = [i for i, part in enumerate(layer.part) if part != slice(None) and at.bottom[0][i] != at.top[0][i]]
    sizes = at.sizes(tuple(at.top[0][i] for i in axes))
    starts = [layer.part[i].start for i in axes]
    ends = [start + size for start, size in zip(starts, sizes)]
    if not axes:
        return at.values[:1]
    return [graph.sliced(at.values[0], starts, ends, axes)]


def interp(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    x, y = at.bottom[0], at.top[0]
    value, cut = at.values[0], layer.inside[1:]
    if (layer.param.pad_beg, layer.param.pad_end) != (0, 0):
        value = graph.sliced(value, [part.start for part in cut], [part.stop for part in cut], [2, 3])
    if [part.stop - part.start for part in cut] == at.sizes(y[2:]):
        return [value]
    size = graph.constant([*at.sizes(x[1:2]), *at.sizes(y[2:])], "size")
    sizes = graph.op("Concat", graph.op("Shape", value, start=0, end=1), size, axis=0)
    options = {"mode": "linear", "coordinate_transformation_mode": "align_corners"}
    return [graph.op("Resize", value, "", "", sizes, **options)]


def upsample(graph: Graph, at: Place) -> list[str]:
    """Translate Upsample; with a mask, scatter the values in each map, because MaxUnpool's indices count through the
    batch.
    """
    layer: Any = at.layer
    if len(at.values) == 1:
        scales = graph.constant([1.0] * (len(at.bottom[0]) - 2) + [float(layer.scale)] * 2, "scales")
        options = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
        return [graph.op("Resize", at.values[0], "", scales, **options)]
    (C, H, W), (Ho, Wo) = at.sizes(at.bottom[0][1:]), at.sizes(at.top[0][2:])
    x, mask = (graph.reshaped(value, ("N", C, H * W)) for value in at.values)
    shape = graph.op("Concat", graph.op("Shape", x, start=0, end=2), graph.constant([Ho * Wo], "size"), axis=0)
    zeros = graph.op("Expand", graph.constant(0.0, "zero"), shape)
    y = graph.op("ScatterElements", zeros, graph.whole(mask), x, axis=2)
    return [graph.reshaped(y, at.top[0])]
