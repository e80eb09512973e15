"""Activations, normalizations, inner products, reductions, and layers that split, join and reshape
blobs, as ONNX operators. Normalizations are those of phase TEST.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import reduce

import numpy as np

from export.onnx.graph import Graph, Place, Translation
from netlib.blob import Array


def of_each(op: str) -> Translation:
    """Return the translation to one elementwise operator."""
    return lambda graph, at: [graph.op(op, at.values[0])]


def relu(graph: Graph, at: Place) -> list[str]:
    slope, x = at.layer.param.negative_slope, at.values[0]
    return [graph.op("LeakyRelu", x, alpha=slope) if slope else graph.op("Relu", x)]


def relu6(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Min", *relu(graph, at), graph.constant(6.0, "six"))]


def prelu(graph: Graph, at: Place) -> list[str]:
    slope = at.layer.blobs[0].data
    spatial_axes = len(at.bottom[0]) - 2
    wide = slope.reshape((*slope.shape, *(1,) * spatial_axes) if slope.shape else 1)
    return [graph.op("PRelu", at.values[0], graph.constant(wide, "slope"))]


def elu(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Elu", at.values[0], alpha=at.layer.param.alpha)]


def power(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    base = graph.affine(at.values[0], p.scale, p.shift)
    return [
        base if p.power == 1 else graph.op("Pow", base, graph.constant(float(p.power), "power"))
    ]


def exp(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [graph.op("Exp", graph.affine(at.values[0], ln_base * p.scale, ln_base * p.shift))]


def log(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [
        graph.affine(graph.op("Log", graph.affine(at.values[0], p.scale, p.shift)), 1 / ln_base, 0)
    ]


def swish(graph: Graph, at: Place) -> list[str]:
    gate = graph.op("Sigmoid", graph.affine(at.values[0], at.layer.param.beta, 0))
    return [graph.op("Mul", at.values[0], gate)]


def clip(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param  # not Clip, whose result differs where max < min
    below = graph.op("Min", at.values[0], graph.constant(float(p.max), "max"))
    return [graph.op("Max", below, graph.constant(float(p.min), "min"))]


def threshold(graph: Graph, at: Place) -> list[str]:
    above = graph.op(
        "Greater", at.values[0], graph.constant(float(at.layer.param.threshold), "threshold")
    )
    return [graph.floats(above)]


def scale(graph: Graph, at: Place) -> list[str]:
    y = _factor_or_term(graph, at, "Mul", "gain")
    if at.layer.param.bias_term:
        term = at.layer.blobs[-1].data
        y = graph.op("Add", y, _wide(graph, at, graph.constant(term, "bias"), term.ndim))
    return [y]


def bias(graph: Graph, at: Place) -> list[str]:
    return [_factor_or_term(graph, at, "Add", "bias")]


def _factor_or_term(graph: Graph, at: Place, op: str, what: str) -> str:
    """Multiply or add the layer's parameter, or its second bottom, to x."""
    if len(at.values) == 1:
        wide, axes = graph.constant(at.layer.blobs[0].data, what), len(at.layer.blobs[0].shape)
    else:
        wide, axes = at.values[1], len(at.bottom[1])
    return graph.op(op, at.values[0], _wide(graph, at, wide, axes))


def _wide(graph: Graph, at: Place, value: str, axes: int) -> str:
    """Align a gain or bias with the axes of x from the layer's ``axis`` on."""
    all_axes = len(at.bottom[0])
    first = at.layer.param.axis % all_axes if axes else 0
    return graph.widened(value, axes, first, all_axes)


def batch_norm(graph: Graph, at: Place) -> list[str]:
    if not at.layer.uses_sums:
        raise at.layer.fail(
            "use_global_stats: false makes items depend on their batch; expected true or no value",
            "use_global_stats",
        )
    mean, variance, weight = (blob.data for blob in at.layer.blobs)
    factor = 1 / weight[0] if weight[0] else 0.0
    parts = {
        "gain": np.ones_like(mean),
        "bias": np.zeros_like(mean),
        "mean": factor * mean,
        "variance": factor * variance,
    }
    return _normalized(graph, at, parts, at.layer.param.eps)


def bn(graph: Graph, at: Place) -> list[str]:
    layer = at.layer
    if layer.of_batch or len(at.top) > 1:
        raise layer.fail(
            "the statistics of a batch cannot be exported; expected bn_mode: INFERENCE", "bn_mode"
        )
    gain, shift, *averages = (blob.data.reshape(-1) for blob in layer.blobs)
    mean, variance = averages or (np.zeros_like(gain), np.ones_like(gain))
    parts = {"scale": gain, "bias": shift, "mean": mean, "variance": variance}
    return _normalized(graph, at, parts, layer.eps if layer.averages else 0.0)


def _normalized(graph: Graph, at: Place, parts: Mapping[str, Array], epsilon: float) -> list[str]:
    """Normalize x by constants for each channel, in the operator's order."""
    constants = [graph.constant(values, what) for what, values in parts.items()]
    return [graph.op("BatchNormalization", at.values[0], *constants, epsilon=epsilon)]


def lrn(graph: Graph, at: Place) -> list[str]:
    p, x = at.layer.param, at.values[0]
    if p.norm_region == "ACROSS_CHANNELS":
        return [graph.op("LRN", x, size=p.local_size, alpha=p.alpha, beta=p.beta, bias=p.k)]
    size = p.local_size
    window = {"kernel_shape": [size, size], "pads": [size // 2] * 4}
    squares = graph.op("Mul", x, x)
    mean = graph.op("AveragePool", squares, count_include_pad=1, **window)
    s = graph.affine(mean, p.alpha, 1)
    return [graph.op("Mul", x, graph.op("Pow", s, graph.constant(-float(p.beta), "power")))]


def mvn(graph: Graph, at: Place) -> list[str]:
    p, x = at.layer.param, at.values[0]
    if at.bottom[0] != at.top[0]:
        x = graph.reshaped(x, at.top[0])
    axes = [1, 2, 3] if p.across_channels else [2, 3]
    y = graph.op("Sub", x, graph.op("ReduceMean", x, axes=axes))
    if p.normalize_variance:
        variance = graph.op("ReduceMean", graph.op("Mul", y, y), axes=axes)
        y = graph.op("Div", y, graph.affine(graph.op("Sqrt", variance), 1, p.eps))
    return [y]


def normalize(graph: Graph, at: Place) -> list[str]:
    x = at.values[0]
    squares = graph.op("ReduceSum", graph.op("Mul", x, x), graph.constant(at.layer.axes, "axes"))
    u = graph.op("Div", x, graph.op("Sqrt", graph.affine(squares, 1, at.layer.param.eps)))
    return [graph.op("Mul", u, graph.constant(at.layer.scale.data.reshape(at.layer.wide), "scale"))]


def inner_product(graph: Graph, at: Place) -> list[str]:
    p, rank = at.layer.param, len(at.bottom[0])
    axis = p.axis % rank
    rows = at.values[0] if (rank, axis) == (2, 1) else graph.op("Flatten", at.values[0], axis=axis)
    parameters = [
        graph.constant(blob.data, name) for blob, name in zip(at.layer.blobs, ("weight", "bias"))
    ]
    y = graph.op("Gemm", rows, *parameters, transB=int(not p.transpose))
    return [y if axis == 1 else graph.reshaped(y, at.top[0])]


def embed(graph: Graph, at: Place) -> list[str]:
    y = graph.op(
        "Gather", graph.constant(at.layer.blobs[0].data, "weight"), graph.whole(at.values[0])
    )
    if at.layer.param.bias_term:
        y = graph.op("Add", y, graph.constant(at.layer.blobs[1].data, "bias"))
    return [y]


def parameter(graph: Graph, at: Place) -> list[str]:
    return [graph.constant(at.layer.blobs[0].data, "weight")]


def dropout(graph: Graph, at: Place) -> list[str]:
    if at.layer.active:
        raise at.layer.fail(
            "sample_weights_test draws random numbers, which cannot be exported",
            "sample_weights_test",
        )
    return [graph.affine(at.values[0], float(at.layer.all_scale), 0)]


def softmax(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Softmax", at.values[0], axis=at.layer.param.axis)]


def eltwise(graph: Graph, at: Place) -> list[str]:
    if at.layer.param.operation == "PROD":
        return [reduce(lambda a, b: graph.op("Mul", a, b), at.values)]
    if at.layer.param.operation == "MAX":
        return [graph.op("Max", *at.values)]
    return [graph.op("Sum", *(graph.affine(x, c, 0) for x, c in zip(at.values, at.layer.coeff)))]


def axpy(graph: Graph, at: Place) -> list[str]:
    a, x, y = at.values
    if len(at.bottom[0]) == 2:
        a = graph.widened(a, 2, 0, len(at.bottom[1]))
    return [graph.op("Add", graph.op("Mul", a, x), y)]


def concat(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Concat", *at.values, axis=at.layer.axis)]


def slice(graph: Graph, at: Place) -> list[str]:
    parts = at.sizes(tuple(shape[at.layer.axis] for shape in at.top))
    if len(parts) == 1:
        return at.values
    return graph.ops(
        "Split", len(parts), at.values[0], graph.constant(parts, "parts"), axis=at.layer.axis
    )


def shuffle_channel(graph: Graph, at: Place) -> list[str]:
    batch = at.bottom[0][0]
    grouped = graph.reshaped(at.values[0], (batch, *at.layer.by_group[1:]))
    order = [0, 2, 1, *range(3, len(at.layer.by_group))]
    return [graph.reshaped(graph.op("Transpose", grouped, perm=order), at.top[0])]


def tile(graph: Graph, at: Place) -> list[str]:
    repeats = [at.layer.param.tiles if i == at.layer.axis else 1 for i in range(len(at.bottom[0]))]
    return [graph.op("Tile", at.values[0], graph.constant(repeats, "repeats"))]


def shaped_as_top(graph: Graph, at: Place) -> list[str]:
    return [graph.reshaped(at.values[0], at.top[0])]


def permute(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Transpose", at.values[0], perm=list(at.layer.axes))]


def same(graph: Graph, at: Place) -> list[str]:
    return at.values * len(at.top)


def nothing(graph: Graph, at: Place) -> list[str]:
    return []


def reduction(graph: Graph, at: Place) -> list[str]:
    p, rank, x = at.layer.param, len(at.bottom[0]), at.values[0]
    axes = list(range(p.axis % rank, rank))
    if p.operation == "SUM":  # in opset 17 the only reduction whose axes are an input
        y = graph.op("ReduceSum", x, graph.constant(axes, "axes"), keepdims=0)
    else:
        op = {"ASUM": "ReduceL1", "SUMSQ": "ReduceSumSquare", "MEAN": "ReduceMean"}[p.operation]
        y = graph.op(op, x, axes=axes, keepdims=0)
    return [graph.affine(y, p.coeff, 0)]


def arg_max(graph: Graph, at: Place) -> list[str]:
    """Reverse the values, since of equal values Caffe selects the last and TopK the first."""
    p, x, shape = at.layer.param, at.values[0], at.bottom[0]
    if p.axis is None:
        x, shape = graph.op("Flatten", x, axis=1), ("N", math.prod(at.sizes(shape[1:])))
    axis = 1 if p.axis is None else p.axis % len(shape)
    last = at.sizes(shape[axis : axis + 1])[0] - 1
    backwards = graph.op(
        "Gather", x, graph.constant(list(range(last, -1, -1)), "backwards"), axis=axis
    )
    values, found = graph.ops("TopK", 2, backwards, graph.constant([p.top_k], "k"), axis=axis)
    if p.axis is not None and p.out_max_val:
        return [values]
    places = graph.floats(graph.op("Sub", graph.constant(last, "last"), found))
    if p.axis is not None:
        return [places]
    both = graph.op("Concat", places, values, axis=1) if p.out_max_val else places
    return [graph.reshaped(both, at.top[0])]


def batch_reindex(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Gather", at.values[0], graph.whole(at.values[1]))]
