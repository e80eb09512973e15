"""Layer types as ONNX operators: one table at the end, layer type → the function that adds its operators.

Such a function gets the graph and the layer at its place, and returns the names of the values that the tops are. A
layer that changes nothing returns the values of its bottoms. Options and formulas are those of the layer's own file in
layers/; a comment here says where ONNX's operator differs from Caffe's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from tools.onnx_graph import Graph, Place
from tools.onnx_hand import hand_model

Translation = Callable[[Graph, Place], list[str]]


# ---------------------------------------------------------------------------------------------- single values


def _of_each(op: str) -> Translation:
    """An operator on every value."""
    return lambda graph, at: [graph.op(op, at.values[0])]


def _relu(graph: Graph, at: Place) -> list[str]:
    slope, x = at.layer.param.negative_slope, at.values[0]
    return [graph.op("LeakyRelu", x, alpha=slope) if slope else graph.op("Relu", x)]


def _prelu(graph: Graph, at: Place) -> list[str]:
    slope = at.layer.blobs[0].data
    wide = slope.reshape(slope.shape + (1,) * (len(at.bottom[0]) - 2)) if slope.shape else slope.reshape(1)
    return [graph.op("PRelu", at.values[0], graph.constant(wide, "slope"))]


def _elu(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Elu", at.values[0], alpha=at.layer.param.alpha)]


def _power(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    base = graph.affine(at.values[0], p.scale, p.shift)
    return [base if p.power == 1 else graph.op("Pow", base, graph.constant(float(p.power), "power"))]


def _exp(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [graph.op("Exp", graph.affine(at.values[0], ln_base * p.scale, ln_base * p.shift))]


def _log(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [graph.affine(graph.op("Log", graph.affine(at.values[0], p.scale, p.shift)), 1 / ln_base, 0)]


def _dropout(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    return [graph.affine(at.values[0], float(layer.in_test), 0)]


def _swish(graph: Graph, at: Place) -> list[str]:
    gate = graph.op("Sigmoid", graph.affine(at.values[0], at.layer.param.beta, 0))
    return [graph.op("Mul", at.values[0], gate)]


def _clip(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param  # not Clip, whose result is another where max is less than min
    below = graph.op("Min", at.values[0], graph.constant(float(p.max), "max"))
    return [graph.op("Max", below, graph.constant(float(p.min), "min"))]


def _threshold(graph: Graph, at: Place) -> list[str]:
    above = graph.op("Greater", at.values[0], graph.constant(float(at.layer.param.threshold), "threshold"))
    return [_floats(graph, above)]


def _floats(graph: Graph, value: str) -> str:
    return graph.op("Cast", value, to=1)  # FLOAT


def _whole(graph: Graph, value: str) -> str:
    return graph.op("Cast", value, to=7)  # INT64


# ---------------------------------------------------------------------------------------------- gains and biases


def _widened(graph: Graph, value: str, axes: int, first: int, all_axes: int) -> str:
    """A value with ``axes`` axes, with axes of size 1 behind them, so that they meet those of x from ``first`` on."""
    behind = all_axes - first - axes
    if not behind:
        return value
    return graph.op("Unsqueeze", value, graph.constant(list(range(axes, axes + behind)), "axes"))


def _factor_or_term(graph: Graph, at: Place, op: str, what: str) -> str:
    """x with the layer's parameter, or its second bottom, multiplied or added."""
    if len(at.values) == 1:
        wide, axes = graph.constant(at.layer.blobs[0].data, what), len(at.layer.blobs[0].shape)
    else:
        wide, axes = at.values[1], len(at.bottom[1])
    return graph.op(op, at.values[0], _widened(graph, wide, axes, _first(at, axes), len(at.bottom[0])))


def _first(at: Place, axes: int) -> int:
    """The axis of x that the first axis of a gain or bias meets."""
    return at.layer.param.axis % len(at.bottom[0]) if axes else 0


def _scale(graph: Graph, at: Place) -> list[str]:
    y = _factor_or_term(graph, at, "Mul", "gain")
    if at.layer.param.bias_term:
        bias = at.layer.blobs[-1]
        axes = len(bias.shape)
        wide = _widened(graph, graph.constant(bias.data, "bias"), axes, _first(at, axes), len(at.bottom[0]))
        y = graph.op("Add", y, wide)
    return [y]


def _bias(graph: Graph, at: Place) -> list[str]:
    return [_factor_or_term(graph, at, "Add", "bias")]


def _axpy(graph: Graph, at: Place) -> list[str]:
    (a, x, y), axes = at.values, len(at.bottom[0])
    if axes == 2:
        a = _widened(graph, a, 2, 0, len(at.bottom[1]))
    return [graph.op("Add", graph.op("Mul", a, x), y)]


# ---------------------------------------------------------------------------------------------- weights


def _convolution(graph: Graph, at: Place) -> list[str]:
    return _sliding(graph, at, "Conv")


def _deconvolution(graph: Graph, at: Place) -> list[str]:
    return _sliding(graph, at, "ConvTranspose")


def _sliding(graph: Graph, at: Place, op: str) -> list[str]:
    """Conv or ConvTranspose of every bottom, with the same weights."""
    layer: Any = at.layer
    w = layer.blobs[0].data
    kernel = list(layer.kernel) or [1]  # a convolution without spatial axes gets one
    options: dict[str, Any] = {"kernel_shape": kernel, "group": layer.param.group}
    if layer.kernel:
        options |= {"strides": list(layer.stride), "dilations": list(layer.dilation), "pads": [*layer.pad, *layer.pad]}
    parameters = [graph.constant(w.reshape(*w.shape[:2], *kernel), "weight")]
    if layer.param.bias_term:
        parameters.append(graph.constant(layer.blobs[1].data, "bias"))
    tops = []
    for value, x, y in zip(at.values, at.bottom, at.top):
        plain = len(x) == len(kernel) + 2
        if not plain:  # other axes than (N, C, ...)
            axis = len(x) - len(layer.kernel) - 1
            value = graph.reshaped(value, ("N", *at.sizes(x[axis:]), *([] if layer.kernel else [1])))
        out = graph.op(op, value, *parameters, **options)
        tops.append(out if plain else graph.reshaped(out, y))
    return tops


def _inner_product(graph: Graph, at: Place) -> list[str]:
    p, rank = at.layer.param, len(at.bottom[0])
    axis = p.axis % rank
    rows = at.values[0] if (rank, axis) == (2, 1) else graph.op("Flatten", at.values[0], axis=axis)
    names = ("weight", "bias")
    parameters = [graph.constant(blob.data, name) for blob, name in zip(at.layer.blobs, names)]
    y = graph.op("Gemm", rows, *parameters, transB=int(not p.transpose))
    return [y if axis == 1 else graph.reshaped(y, at.top[0])]


def _embed(graph: Graph, at: Place) -> list[str]:
    y = graph.op("Gather", graph.constant(at.layer.blobs[0].data, "weight"), _whole(graph, at.values[0]))
    if at.layer.param.bias_term:
        y = graph.op("Add", y, graph.constant(at.layer.blobs[1].data, "bias"))
    return [y]


def _parameter(graph: Graph, at: Place) -> list[str]:
    return [graph.constant(at.layer.blobs[0].data, "weight")]


# ---------------------------------------------------------------------------------------------- windows


def _pooling(graph: Graph, at: Place) -> list[str]:
    """Windows as Caffe places them: as many as the top has, with pads that make room for just these.

    ONNX's ceil_mode would keep windows that Caffe drops, and its mean does not count as Caffe's. So output sizes are
    rounded down here, the pads at the end are what the last window needs, and where such a window hangs over the
    padding, which Caffe does not count, the mean of all its places is corrected by a constant. A last window beyond
    the image (stride > kernel) has no value, and operators refuse it: it is put there afterwards.
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
                               "pads": [*layer.pad, *after]}  # fmt: skip
    beyond = [o - i for o, i in zip(outputs, inside)]

    def completed(y: str, nothing: float) -> str:
        if not any(beyond):
            return y
        return graph.op("Pad", y, graph.constant([0] * 6 + beyond, "beyond"), graph.constant(nothing, "nothing"))

    if is_max:
        y = graph.ops("MaxPool", len(at.top), x, **options)
        if len(y) > 1:  # counted through all items and channels
            place = graph.op("Mod", y[1], graph.constant(math.prod(n for n, *_ in axes), "map"))
            y[1] = completed(_floats(graph, place), -1.0)
        return [completed(y[0], float(np.finfo(np.float32).min)), *y[1:]]
    mean = completed(graph.op("AveragePool", x, count_include_pad=1, **options), 0.0)
    starts = [np.arange(o) * s - p for o, (_, _, s, p) in zip(outputs, axes)]
    counted = [np.minimum(start + k, n + p) - start for start, (n, k, _, p) in zip(starts, axes)]
    with np.errstate(divide="ignore"):
        correction = math.prod(layer.kernel) / np.outer(*counted)  # 0 x infinity is NaN, as Caffe's 0 / 0
    return [mean if (correction == 1).all() else graph.op("Mul", mean, graph.constant(correction, "correction"))]


def _spp(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    sizes, levels = at.sizes(at.bottom[0][2:]), []
    for level in range(layer.param.pyramid_height):
        kernel = [-(-n // 2**level) for n in sizes]
        missing = [k * 2**level - n for k, n in zip(kernel, sizes)]
        before = [(m + 1) // 2 for m in missing]
        options: dict[str, Any] = {"kernel_shape": kernel, "strides": kernel,
                                   "pads": [*before, *(m - b for m, b in zip(missing, before))]}  # fmt: skip
        if layer.param.pool == "MAX":
            levels.append(graph.op("MaxPool", at.values[0], **options))
        else:
            levels.append(graph.op("AveragePool", at.values[0], count_include_pad=1, **options))
    if len(levels) == 1:
        return levels
    return [graph.op("Concat", *(graph.op("Flatten", level, axis=1) for level in levels), axis=1)]


# ---------------------------------------------------------------------------------------------- normalization


def _batch_norm(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if not layer.uses_sums:
        raise layer.fail("with use_global_stats: false, each item depends on its batch; expected true, or none",
                         "use_global_stats")  # fmt: skip
    mean, variance, weight = (blob.data for blob in layer.blobs)
    factor = 1 / weight[0] if weight[0] else 0.0
    parts = {
        "gain": np.ones_like(mean),
        "bias": np.zeros_like(mean),
        "mean": factor * mean,
        "variance": factor * variance,
    }
    constants = [graph.constant(values, what) for what, values in parts.items()]
    return [graph.op("BatchNormalization", at.values[0], *constants, epsilon=layer.param.eps)]


def _lrn(graph: Graph, at: Place) -> list[str]:
    p, x = at.layer.param, at.values[0]
    if p.norm_region == "ACROSS_CHANNELS":
        return [graph.op("LRN", x, size=p.local_size, alpha=p.alpha, beta=p.beta, bias=p.k)]
    mean = graph.op("AveragePool", graph.op("Mul", x, x), kernel_shape=[p.local_size] * 2,
                    pads=[p.local_size // 2] * 4, count_include_pad=1)  # fmt: skip
    s = graph.affine(mean, p.alpha, 1)
    return [graph.op("Mul", x, graph.op("Pow", s, graph.constant(-float(p.beta), "power")))]


def _mvn(graph: Graph, at: Place) -> list[str]:
    p, x = at.layer.param, at.values[0]
    if at.bottom[0] != at.top[0]:
        x = graph.reshaped(x, at.top[0])
    axes = [1, 2, 3] if p.across_channels else [2, 3]
    y = graph.op("Sub", x, graph.op("ReduceMean", x, axes=axes))
    if p.normalize_variance:
        variance = graph.op("ReduceMean", graph.op("Mul", y, y), axes=axes)
        y = graph.op("Div", y, graph.affine(graph.op("Sqrt", variance), 1, p.eps))
    return [y]


def _softmax(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Softmax", at.values[0], axis=at.layer.param.axis)]


# ---------------------------------------------------------------------------------------------- several blobs, shapes


def _eltwise(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if layer.param.operation == "PROD":
        return [reduce(lambda a, b: graph.op("Mul", a, b), at.values)]
    if layer.param.operation == "MAX":
        return [graph.op("Max", *at.values)]
    return [graph.op("Sum", *(graph.affine(x, c, 0) for x, c in zip(at.values, layer.coeff)))]


def _concat(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    return [graph.op("Concat", *at.values, axis=layer.axis)]


def _slice(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    parts = at.sizes(tuple(shape[layer.axis] for shape in at.top))
    if len(parts) == 1:
        return at.values
    return graph.ops("Split", len(parts), at.values[0], graph.constant(parts, "parts"), axis=layer.axis)


def _tile(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    repeats = [layer.param.tiles if i == layer.axis else 1 for i in range(len(at.bottom[0]))]
    return [graph.op("Tile", at.values[0], graph.constant(repeats, "repeats"))]


def _crop(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    axes = [i for i, part in enumerate(layer.part) if part != slice(None) and at.bottom[0][i] != at.top[0][i]]
    sizes = at.sizes(tuple(at.top[0][i] for i in axes))
    starts = [layer.part[i].start for i in axes]
    ends = [start + size for start, size in zip(starts, sizes)]
    if not axes:
        return at.values[:1]
    bounds = (graph.constant(numbers, what) for what, numbers in (("starts", starts), ("ends", ends), ("axes", axes)))
    return [graph.op("Slice", at.values[0], *bounds)]


def _shaped_as_top(graph: Graph, at: Place) -> list[str]:
    return [graph.reshaped(at.values[0], at.top[0])]


def _same(graph: Graph, at: Place) -> list[str]:
    return at.values * len(at.top)


def _nothing(graph: Graph, at: Place) -> list[str]:
    return []


# ---------------------------------------------------------------------------------------------- numbers of values


def _reduction(graph: Graph, at: Place) -> list[str]:
    p, rank, x = at.layer.param, len(at.bottom[0]), at.values[0]
    axes = list(range(p.axis % rank, rank))
    if p.operation == "SUM":  # the first that got its axes as an input
        y = graph.op("ReduceSum", x, graph.constant(axes, "axes"), keepdims=0)
    else:
        op = {"ASUM": "ReduceL1", "SUMSQ": "ReduceSumSquare", "MEAN": "ReduceMean"}[p.operation]
        y = graph.op(op, x, axes=axes, keepdims=0)
    return [graph.affine(y, p.coeff, 0)]


def _arg_max(graph: Graph, at: Place) -> list[str]:
    """Of equal values Caffe takes the last first, TopK the first: it gets them in reverse."""
    p, x, shape = at.layer.param, at.values[0], at.bottom[0]
    if p.axis is None:
        x, shape = graph.op("Flatten", x, axis=1), ("N", math.prod(at.sizes(shape[1:])))
    axis = 1 if p.axis is None else p.axis % len(shape)
    last = at.sizes(shape[axis : axis + 1])[0] - 1
    backwards = graph.op("Gather", x, graph.constant(list(range(last, -1, -1)), "backwards"), axis=axis)
    values, found = graph.ops("TopK", 2, backwards, graph.constant([p.top_k], "k"), axis=axis)
    if p.axis is not None and p.out_max_val:
        return [values]
    places = _floats(graph, graph.op("Sub", graph.constant(last, "last"), found))
    if p.axis is not None:
        return [places]
    both = graph.op("Concat", places, values, axis=1) if p.out_max_val else places
    return [graph.reshaped(both, at.top[0])]


def _batch_reindex(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Gather", at.values[0], _whole(graph, at.values[1]))]


LAYERS: dict[str, Translation] = {
    "AbsVal": _of_each("Abs"),
    "ArgMax": _arg_max,
    "Axpy": _axpy,
    "BNLL": _of_each("Softplus"),
    "BatchNorm": _batch_norm,
    "BatchReindex": _batch_reindex,
    "Bias": _bias,
    "Clip": _clip,
    "Concat": _concat,
    "Convolution": _convolution,
    "Crop": _crop,
    "Deconvolution": _deconvolution,
    "DeepHandModel": hand_model,  # the released system's name
    "Dropout": _dropout,
    "ELU": _elu,
    "Eltwise": _eltwise,
    "Embed": _embed,
    "Exp": _exp,
    "Flatten": _shaped_as_top,
    "HandModel": hand_model,
    "InnerProduct": _inner_product,
    "Input": _nothing,  # inputs are the graph's own
    "LRN": _lrn,
    "Log": _log,
    "MVN": _mvn,
    "PReLU": _prelu,
    "Parameter": _parameter,
    "Pooling": _pooling,
    "Power": _power,
    "ReLU": _relu,
    "Reduction": _reduction,
    "Reshape": _shaped_as_top,
    "SPP": _spp,
    "Scale": _scale,
    "Sigmoid": _of_each("Sigmoid"),
    "Silence": _nothing,
    "Slice": _slice,
    "Softmax": _softmax,
    "Split": _same,
    "Swish": _swish,
    "TanH": _of_each("Tanh"),
    "Threshold": _threshold,
    "Tile": _tile,
}
