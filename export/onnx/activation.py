"""Activations, scales and biases as ONNX operators."""

from __future__ import annotations

import math

from export.onnx.graph import Graph, Place, Translation


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
    wide = slope.reshape(slope.shape + (1,) * (len(at.bottom[0]) - 2)) if slope.shape else slope.reshape(1)
    return [graph.op("PRelu", at.values[0], graph.constant(wide, "slope"))]


def elu(graph: Graph, at: Place) -> list[str]:
    return [graph.op("Elu", at.values[0], alpha=at.layer.param.alpha)]


def power(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    base = graph.affine(at.values[0], p.scale, p.shift)
    return [base if p.power == 1 else graph.op("Pow", base, graph.constant(float(p.power), "power"))]


def exp(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [graph.op("Exp", graph.affine(at.values[0], ln_base * p.scale, ln_base * p.shift))]


def log(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param
    ln_base = 1.0 if p.base == -1 else math.log(p.base)
    return [graph.affine(graph.op("Log", graph.affine(at.values[0], p.scale, p.shift)), 1 / ln_base, 0)]


def swish(graph: Graph, at: Place) -> list[str]:
    gate = graph.op("Sigmoid", graph.affine(at.values[0], at.layer.param.beta, 0))
    return [graph.op("Mul", at.values[0], gate)]


def clip(graph: Graph, at: Place) -> list[str]:
    p = at.layer.param  # not Clip, whose result differs where max < min
    below = graph.op("Min", at.values[0], graph.constant(float(p.max), "max"))
    return [graph.op("Max", below, graph.constant(float(p.min), "min"))]


def threshold(graph: Graph, at: Place) -> list[str]:
    above = graph.op("Greater", at.values[0], graph.constant(float(at.layer.param.threshold), "threshold"))
    return [graph.floats(above)]


def scale(graph: Graph, at: Place) -> list[str]:
    y = _factor_or_term(graph, at, "Mul", "gain")
    if at.layer.param.bias_term:
        bias = at.layer.blobs[-1]
        axes = len(bias.shape)
        wide = graph.widened(graph.constant(bias.data, "bias"), axes, _first(at, axes), len(at.bottom[0]))
        y = graph.op("Add", y, wide)
    return [y]


def bias(graph: Graph, at: Place) -> list[str]:
    return [_factor_or_term(graph, at, "Add", "bias")]


def _factor_or_term(graph: Graph, at: Place, op: str, what: str) -> str:
    """Multiply or add the layer's parameter, or its second bottom, to x."""
    if len(at.values) == 1:
        wide, axes = graph.constant(at.layer.blobs[0].data, what), len(at.layer.blobs[0].shape)
    else:
        wide, axes = at.values[1], len(at.bottom[1])
    return graph.op(op, at.values[0], graph.widened(wide, axes, _first(at, axes), len(at.bottom[0])))


def _first(at: Place, axes: int) -> int:
    """Return the axis of x that the first axis of a gain or bias is aligned with."""
    return at.layer.param.axis % len(at.bottom[0]) if axes else 0
