"""Normalizations as ONNX operators, in phase TEST."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from export.onnx.graph import Graph, Place
from netlib.blob import Array


def batch_norm(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if not layer.uses_sums:
        raise layer.fail("use_global_stats: false makes items depend on their batch; expected true or no value",
                         "use_global_stats")
    mean, variance, weight = (blob.data for blob in layer.blobs)
    factor = 1 / weight[0] if weight[0] else 0.0
    parts = {"gain": np.ones_like(mean), "bias": np.zeros_like(mean), "mean": factor * mean,
             "variance": factor * variance}
    return _normalized(graph, at, parts, layer.param.eps)


def bn(graph: Graph, at: Place) -> list[str]:
    layer: Any = at.layer
    if layer.of_batch or len(at.top) > 1:
        raise layer.fail("the statistics of a batch cannot be exported; expected bn_mode: INFERENCE", "bn_mode")
    scale, bias, *averages = (blob.data.reshape(-1) for blob in layer.blobs)
    mean, variance = averages or (np.zeros_like(scale), np.ones_like(scale))
    parts = {"scale": scale, "bias": bias, "mean": mean, "variance": variance}
    return _normalized(graph, at, parts, layer.eps if layer.averages else 0.0)


def _normalized(graph: Graph, at: Place, parts: Mapping[str, Array], epsilon: float) -> list[str]:
    """Normalize x by constants for each channel, in the operator's order."""
    constants = [graph.constant(values, what) for what, values in parts.items()]
    return [graph.op("BatchNormalization", at.values[0], *constants, epsilon=epsilon)]


def lrn(graph: Graph, at: Place) -> list[str]:
    p, x = at.layer.param, at.values[0]
    if p.norm_region == "ACROSS_CHANNELS":
        return [graph.op("LRN", x, size=p.local_size, alpha=p.alpha, beta=p.beta, bias=p.k)]
    mean = graph.op("AveragePool", graph.op("Mul", x, x), kernel_shape=[p.local_size] * 2,
                    pads=[p.local_size // 2] * 4, count_include_pad=1)
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
    layer: Any = at.layer
    x = at.values[0]
    squares = graph.op("ReduceSum", graph.op("Mul", x, x), graph.constant(layer.axes, "axes"))
    u = graph.op("Div", x, graph.op("Sqrt", graph.affine(squares, 1, layer.param.eps)))
    return [graph.op("Mul", u, graph.constant(layer.scale.data.reshape(layer.wide), "scale"))]
