"""Caffe's fillers: initial values of parameters.

    constant   value                          uniform    U(min, max)
    gaussian   N(mean, std²)                  xavier     U(-a, a), a = sqrt(3 / n)
    msra       N(0, 2 / n)                    positive_unitball, bilinear: as in Caffe

with n the fan-in, the fan-out or their mean (``variance_norm``). As in Caffe, fan-in is
count / shape[0] and fan-out is count / shape[1], regardless of how the layer uses the axes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from netlib.blob import blocks
from netlib.errors import PrototxtError, meant_or_known
from netlib.proto import schema
from netlib.proto.messages import Filler

__all__ = ["Filler", "check", "fill"]

BLOCK = 1 << 20  # numbers drawn at a time
TYPES = ("constant", "uniform", "gaussian", "xavier", "msra", "positive_unitball", "bilinear")


def check(shape: tuple[int, ...], filler: Filler) -> None:
    """Raise PrototxtError for an unknown type, or for options that cannot fill an array
    of this shape.
    """
    if filler.type not in TYPES:
        advice = meant_or_known(filler.type, TYPES, "known types:")
        raise PrototxtError(
            schema.position_of(filler, "type"), f"unknown filler type {filler.type!r}{advice}"
        )
    fault = _fault(shape, filler)
    if fault:
        raise PrototxtError(schema.position_of(filler, "type"), f"filler {filler.type!r}: {fault}")


def fill(array: NDArray[Any], filler: Filler, rng: np.random.Generator) -> None:
    """Set every element of ``array``. Raises PrototxtError as ``check`` does."""
    check(array.shape, filler)
    if filler.type == "constant":
        array[...] = filler.value
    elif filler.type == "uniform":
        _draw(array, lambda count: rng.uniform(filler.min, filler.max, count))
    elif filler.type == "gaussian":
        _draw(array, lambda count: rng.normal(filler.mean, filler.std, count))
        if filler.sparse >= 0:
            array *= rng.random(array.shape) < min(1.0, filler.sparse / array.shape[0])
    elif filler.type == "xavier":
        bound = np.sqrt(3 / _fan(array.shape, filler))
        _draw(array, lambda count: rng.uniform(-bound, bound, count))
    elif filler.type == "msra":
        deviation = np.sqrt(2 / _fan(array.shape, filler))
        _draw(array, lambda count: rng.normal(0.0, deviation, count))
    elif filler.type == "positive_unitball":
        _draw(array, rng.random)
        array /= array.sum(axis=tuple(range(1, array.ndim)), keepdims=True)
    else:
        array[...] = _bilinear(array.shape)


def _draw(array: NDArray[Any], draw: Callable[[int], NDArray[np.float64]]) -> None:
    """Fill ``array`` with random numbers, block by block, because they are drawn in float64."""
    flat = array.reshape(-1)
    for part in blocks(flat.size, BLOCK):
        flat[part] = draw(part.stop - part.start)


def _fault(shape: tuple[int, ...], filler: Filler) -> str:
    """Describe what is wrong with the options or the shape; empty if nothing is."""
    if filler.type == "gaussian" and not filler.std >= 0:
        return f"std {filler.std:g} must not be negative"
    if filler.type == "gaussian" and filler.sparse >= 0 and not shape:
        return "sparse needs weights with an output axis, found a single number"
    if filler.type == "uniform" and not -np.inf < filler.min <= filler.max < np.inf:
        return (
            f"min {filler.min:g} and max {filler.max:g} must be finite, and min must not exceed max"
        )
    if filler.type in ("xavier", "msra", "positive_unitball") and (not shape or 0 in shape):
        return f"cannot fill a parameter of shape {shape}"
    if filler.type == "bilinear" and (len(shape) != 4 or shape[2] != shape[3]):
        return f"fills kernels (O, C, k, k), not {shape}"
    return ""


def _fan(shape: tuple[int, ...], filler: Filler) -> float:
    count = float(np.prod(shape))
    fan_in = count / shape[0]
    fan_out = count / (shape[1] if len(shape) > 1 else 1)
    return {"FAN_IN": fan_in, "FAN_OUT": fan_out, "AVERAGE": (fan_in + fan_out) / 2}[
        filler.variance_norm
    ]


def _bilinear(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Interpolation kernel for upsampling by ceil(width / 2)."""
    width = shape[-1]
    factor = (width + 1) // 2
    centre = (2 * factor - 1 - factor % 2) / (2 * factor)
    line = 1 - np.abs(np.arange(width) / factor - centre)
    return np.broadcast_to(np.outer(line, line), shape)
