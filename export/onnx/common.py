"""Activations, normalizations, inner products, reductions, and layers that split, join and reshape
blobs, as ONNX operators. Normalizations are those of phase TEST.

A public function adds the operators of one layer type (net.py) to the graph, and returns the names
of the values of its tops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial, reduce

import numpy as np

from export.onnx.graph import Graph, LayerCall, Translation
from netlib.blob import Array


def of_each(op: str) -> Translation:
    """Return the translation to one elementwise operator."""
    return lambda graph, call: [graph.op(op, call.values[0])]


def relu(graph: Graph, call: LayerCall) -> list[str]:
    slope = call.layer.param.negative_slope
    x = call.values[0]
    return [graph.op("LeakyRelu", x, alpha=slope) if slope else graph.op("Relu", x)]


def relu6(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Min", *relu(graph, call), graph.constant(6.0, "six"))]


def prelu(graph: Graph, call: LayerCall) -> list[str]:
    slope = call.layer.blobs[0].data
    ones = (1,) * (len(call.bottom[0]) - 2)  # for the spatial axes
    slope = slope.reshape((*slope.shape, *ones) if slope.shape else 1)
    return [graph.op("PRelu", call.values[0], graph.constant(slope, "slope"))]


def elu(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Elu", call.values[0], alpha=call.layer.param.alpha)]


def power(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    y = graph.affine(call.values[0], p.scale, p.shift)
    if p.power != 1:
        y = graph.op("Pow", y, graph.constant(float(p.power), "power"))
    return [y]


def exp(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    ln_base = _ln_base(p.base)
    return [graph.op("Exp", graph.affine(call.values[0], ln_base * p.scale, ln_base * p.shift))]


def log(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    ln_base = _ln_base(p.base)
    y = graph.op("Log", graph.affine(call.values[0], p.scale, p.shift))
    return [graph.affine(y, 1 / ln_base, 0)]


def _ln_base(base: float) -> float:
    """The natural logarithm of a base, of which -1 stands for e."""
    return 1.0 if base == -1 else math.log(base)


def swish(graph: Graph, call: LayerCall) -> list[str]:
    gate = graph.op("Sigmoid", graph.affine(call.values[0], call.layer.param.beta, 0))
    return [graph.op("Mul", call.values[0], gate)]


def clip(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param  # not Clip, whose result differs where max < min
    below = graph.op("Min", call.values[0], graph.constant(float(p.max), "max"))
    return [graph.op("Max", below, graph.constant(float(p.min), "min"))]


def threshold(graph: Graph, call: LayerCall) -> list[str]:
    threshold = graph.constant(float(call.layer.param.threshold), "threshold")
    return [graph.to_float(graph.op("Greater", call.values[0], threshold))]


def scale(graph: Graph, call: LayerCall) -> list[str]:
    y = _factor_or_term(graph, call, "Mul", "gain")
    if call.layer.param.bias_term:
        term = call.layer.blobs[-1].data
        y = graph.op("Add", y, _aligned(graph, call, graph.constant(term, "bias"), term.ndim))
    return [y]


def bias(graph: Graph, call: LayerCall) -> list[str]:
    return [_factor_or_term(graph, call, "Add", "bias")]


def _factor_or_term(graph: Graph, call: LayerCall, op: str, what: str) -> str:
    """Multiply or add the layer's parameter, or its second bottom, to x."""
    if len(call.values) == 1:
        array = call.layer.blobs[0].data
        value, axes = graph.constant(array, what), array.ndim
    else:
        value, axes = call.values[1], len(call.bottom[1])
    return graph.op(op, call.values[0], _aligned(graph, call, value, axes))


def _aligned(graph: Graph, call: LayerCall, value: str, axes: int) -> str:
    """Align a gain or bias with the axes of x from the layer's ``axis`` on."""
    all_axes = len(call.bottom[0])
    first = call.layer.param.axis % all_axes if axes else 0
    return graph.widened(value, axes, first, all_axes)


def batch_norm(graph: Graph, call: LayerCall) -> list[str]:
    if not call.layer.uses_sums:
        raise call.layer.fail(
            "use_global_stats: false makes items depend on their batch; expected true or no value",
            "use_global_stats",
        )
    mean, variance, weight = (blob.data for blob in call.layer.blobs)
    factor = 1 / weight[0] if weight[0] else 0.0
    parts = {
        "gain": np.ones_like(mean),
        "bias": np.zeros_like(mean),
        "mean": factor * mean,
        "variance": factor * variance,
    }
    return _normalized(graph, call, parts, call.layer.param.eps)


def bn(graph: Graph, call: LayerCall) -> list[str]:
    layer = call.layer
    if layer.of_batch or len(call.top) > 1:
        raise layer.fail(
            "the statistics of a batch cannot be exported; expected bn_mode: INFERENCE", "bn_mode"
        )
    gain, shift, *averages = (blob.data.reshape(-1) for blob in layer.blobs)
    mean, variance = averages or (np.zeros_like(gain), np.ones_like(gain))
    parts = {"scale": gain, "bias": shift, "mean": mean, "variance": variance}
    return _normalized(graph, call, parts, layer.eps if layer.averages else 0.0)


def _normalized(
    graph: Graph, call: LayerCall, parts: Mapping[str, Array], epsilon: float
) -> list[str]:
    """Normalize x by constants for each channel, in the operator's order."""
    constants = [graph.constant(values, what) for what, values in parts.items()]
    return [graph.op("BatchNormalization", call.values[0], *constants, epsilon=epsilon)]


def lrn(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    x = call.values[0]
    if p.norm_region == "ACROSS_CHANNELS":
        return [graph.op("LRN", x, size=p.local_size, alpha=p.alpha, beta=p.beta, bias=p.k)]
    size = p.local_size
    squares = graph.op("Mul", x, x)
    mean = graph.op(
        "AveragePool", squares, count_include_pad=1, kernel_shape=[size, size], pads=[size // 2] * 4
    )
    s = graph.affine(mean, p.alpha, 1)
    return [graph.op("Mul", x, graph.op("Pow", s, graph.constant(-float(p.beta), "power")))]


def mvn(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    x = call.values[0]
    if call.bottom[0] != call.top[0]:
        x = graph.reshaped(x, call.top[0])
    axes = [1, 2, 3] if p.across_channels else [2, 3]
    y = graph.op("Sub", x, graph.op("ReduceMean", x, axes=axes))
    if p.normalize_variance:
        variance = graph.op("ReduceMean", graph.op("Mul", y, y), axes=axes)
        y = graph.op("Div", y, graph.affine(graph.op("Sqrt", variance), 1, p.eps))
    return [y]


def normalize(graph: Graph, call: LayerCall) -> list[str]:
    x = call.values[0]
    squares = graph.op("ReduceSum", graph.op("Mul", x, x), graph.constant(call.layer.axes, "axes"))
    u = graph.op("Div", x, graph.op("Sqrt", graph.affine(squares, 1, call.layer.param.eps)))
    return [
        graph.op("Mul", u, graph.constant(call.layer.scale.data.reshape(call.layer.wide), "scale"))
    ]


def inner_product(graph: Graph, call: LayerCall) -> list[str]:
    p = call.layer.param
    rank = len(call.bottom[0])
    axis = p.axis % rank
    rows = call.values[0]
    if (rank, axis) != (2, 1):
        rows = graph.op("Flatten", rows, axis=axis)
    parameters = [
        graph.constant(blob.data, name) for blob, name in zip(call.layer.blobs, ("weight", "bias"))
    ]
    y = graph.op("Gemm", rows, *parameters, transB=int(not p.transpose))
    return [y if axis == 1 else graph.reshaped(y, call.top[0])]


def embed(graph: Graph, call: LayerCall) -> list[str]:
    weight = graph.constant(call.layer.blobs[0].data, "weight")
    y = graph.op("Gather", weight, graph.to_int(call.values[0]))
    if call.layer.param.bias_term:
        y = graph.op("Add", y, graph.constant(call.layer.blobs[1].data, "bias"))
    return [y]


def parameter(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.constant(call.layer.blobs[0].data, "weight")]


def dropout(graph: Graph, call: LayerCall) -> list[str]:
    if call.layer.active:
        raise call.layer.fail(
            "sample_weights_test draws random numbers, which cannot be exported",
            "sample_weights_test",
        )
    return [graph.affine(call.values[0], float(call.layer.all_scale), 0)]


def softmax(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Softmax", call.values[0], axis=call.layer.param.axis)]


def eltwise(graph: Graph, call: LayerCall) -> list[str]:
    if call.layer.param.operation == "PROD":
        return [reduce(partial(graph.op, "Mul"), call.values)]
    if call.layer.param.operation == "MAX":
        return [graph.op("Max", *call.values)]
    terms = [graph.affine(x, c, 0) for x, c in zip(call.values, call.layer.coeff)]
    return [graph.op("Sum", *terms)]


def axpy(graph: Graph, call: LayerCall) -> list[str]:
    a, x, y = call.values
    if len(call.bottom[0]) == 2:
        a = graph.widened(a, 2, 0, len(call.bottom[1]))
    return [graph.op("Add", graph.op("Mul", a, x), y)]


def concat(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Concat", *call.values, axis=call.layer.axis)]


def slice_(graph: Graph, call: LayerCall) -> list[str]:
    axis = call.layer.axis
    parts = call.sizes(tuple(shape[axis] for shape in call.top))
    if len(parts) == 1:
        return call.values
    sizes = graph.constant(parts, "parts")
    return graph.ops("Split", len(parts), call.values[0], sizes, axis=axis)


def shuffle_channel(graph: Graph, call: LayerCall) -> list[str]:
    batch = call.bottom[0][0]
    grouped = graph.reshaped(call.values[0], (batch, *call.layer.by_group[1:]))
    order = [0, 2, 1, *range(3, len(call.layer.by_group))]
    return [graph.reshaped(graph.op("Transpose", grouped, perm=order), call.top[0])]


def tile(graph: Graph, call: LayerCall) -> list[str]:
    repeats = [1] * len(call.bottom[0])
    repeats[call.layer.axis] = call.layer.param.tiles
    return [graph.op("Tile", call.values[0], graph.constant(repeats, "repeats"))]


def shaped_as_top(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.reshaped(call.values[0], call.top[0])]


def permute(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Transpose", call.values[0], perm=list(call.layer.axes))]


def same(graph: Graph, call: LayerCall) -> list[str]:
    return call.values * len(call.top)


def nothing(graph: Graph, call: LayerCall) -> list[str]:
    return []


def reduction(graph: Graph, call: LayerCall) -> list[str]:
    p, rank, x = call.layer.param, len(call.bottom[0]), call.values[0]
    axes = list(range(p.axis % rank, rank))
    if p.operation == "SUM":  # in opset 17 the only reduction whose axes are an input
        y = graph.op("ReduceSum", x, graph.constant(axes, "axes"), keepdims=0)
    else:
        op = {"ASUM": "ReduceL1", "SUMSQ": "ReduceSumSquare", "MEAN": "ReduceMean"}[p.operation]
        y = graph.op(op, x, axes=axes, keepdims=0)
    return [graph.affine(y, p.coeff, 0)]


def arg_max(graph: Graph, call: LayerCall) -> list[str]:
    """Reverse the values, since of equal values Caffe selects the last and TopK the first."""
    p, x, shape = call.layer.param, call.values[0], call.bottom[0]
    if p.axis is None:
        x = graph.op("Flatten", x, axis=1)
        shape = ("N", math.prod(call.sizes(shape[1:])))
    axis = 1 if p.axis is None else p.axis % len(shape)
    last = call.sizes(shape[axis : axis + 1])[0] - 1
    order = graph.constant(list(range(last, -1, -1)), "backwards")
    backwards = graph.op("Gather", x, order, axis=axis)
    values, found = graph.ops("TopK", 2, backwards, graph.constant([p.top_k], "k"), axis=axis)
    if p.axis is not None and p.out_max_val:
        return [values]
    indices = graph.to_float(graph.op("Sub", graph.constant(last, "last"), found))
    if p.axis is not None:
        return [indices]
    if p.out_max_val:
        indices = graph.op("Concat", indices, values, axis=1)
    return [graph.reshaped(indices, call.top[0])]


def batch_reindex(graph: Graph, call: LayerCall) -> list[str]:
    return [graph.op("Gather", call.values[0], graph.to_int(call.values[1]))]
