"""Inner products, reductions, and layers that split, join and reshape blobs, as ONNX operators."""

from __future__ import annotations

import math
from functools import reduce
from typing import Any

from export.onnx.graph import Graph, Place


def inner_product(graph: Graph, at: Place) -> list[str]:
    p, rank = at.layer.param, len(at.bottom[0])
    axis = p.axis % rank
    rows = at.values[0] if (rank, axis) == (2, 1) else graph.op("Flatten", at.values[0], axis=axis)
    names = ("weight", "bias")
    parameters = [graph.constant(blob.data, name) for blob, name in zip(at.layer.blobs, names)]
    y = graph.op("Gemm", rows, *parameters, transB=int(not p.transpose))
    return [y if axis == 1 else graph.reshaped(y, at.top[0])]


def embed(graph: Graph, at: Place) -> list[str]:
    y = graph.op("Gather", graph.constant(at.layer.blobs[0].data, "weight"), graph.whole(at.values[0]))
    if at.layer.param.bias_term:
        y = graph.op("Add", y, graph.constant(at.layer.blobs[1].data, "bias"))
    return [y]


def parameter(graph: Graph, at: Place) -> list[str]:
    return [graph.constant(at.layer.blobs[0].data, "weight")]


def dropout(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if layer.active:
        raise layer.fail("sample_weights_test draws random numbers, which cannot be exported", "sample_weights_test")
    return [graph.affine(at.values[0], float(layer.in_test), 0)]


def softmax(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Softmax", at.values[0], axis=at.layer.param.axis)]


def eltwise(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if layer.param.operation == "PROD":
        return [reduce(lambda a, b: graph.op("Mul", a, b), at.values)]
    if layer.param.operation == "MAX":
        return [graph.op("Max", *at.values)]
    return [graph.op("Sum", *(graph.affine(x, c, 0) for x, c in zip(at.values, layer.coeff)))]


def axpy(graph: Graph, at: Place) -> list[str]:
    (a, x, y), axes = at.values, len(at.bottom[0])
    if axes == 2:
        a = graph.widened(a, 2, 0, len(at.bottom[1]))
    return [graph.op("Add", graph.op("Mul", a, x), y)]


def concat(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    return [graph.op("Concat", *at.values, axis=layer.axis)]


def slice(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    parts = at.sizes(tuple(shape[layer.axis] for shape in at.top))
    if len(parts) == 1:
        return at.values
    return graph.ops("Split", len(parts), at.values[0], graph.constant(parts, "parts"), axis=layer.axis)


def shuffle_channel(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    batch = at.bottom[0][0]
    grouped = graph.reshaped(at.values[0], (batch, *layer.by_group[1:]))
    order = [0, 2, 1, *range(3, len(layer.by_group))]
    return [graph.reshaped(graph.op("Transpose", grouped, perm=order), at.top[0])]


def tile(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    repeats = [layer.param.tiles if i == layer.axis else 1 for i in range(len(at.bottom[0]))]
    return [graph.op("Tile", at.values[0], graph.constant(repeats, "repeats"))]


def shaped_as_top(graph: Graph, at: Place) -> list[str]:
    return [graph.reshaped(at.values[0], at.top[0])]


def permute(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    return [graph.op("Transpose", at.values[0], perm=list(layer.axes))]


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
    backwards = graph.op("Gather", x, graph.constant(list(range(last, -1, -1)), "backwards"), axis=axis)
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
