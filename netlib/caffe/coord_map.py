"""caffe.coord_map: where a point of one top lies in another, through the layers between them.

A map is (axis, a, b): a point at x lies at a * x + b, from ``axis`` on, the axis before the first spatial one. ``a``
and ``b`` are arrays with one number per spatial axis, or one number for all. (None, 1, 0) changes nothing and has no
axis. ``crop`` is what this is for: it cuts an upsampled top so that it lies exactly on another.
"""

from __future__ import annotations

from collections import deque
from typing import Any, TypeAlias

import numpy as np

from netlib.blob import Array
from netlib.caffe.net_spec import Function, Top, layers
from netlib.errors import NetlibError

Map: TypeAlias = "tuple[int | None, Array | float, Array | float]"
IDENTITY: Map = (None, 1, 0)

PASS_THROUGH_LAYERS = ["AbsVal", "BatchNorm", "Bias", "BNLL", "Dropout", "Eltwise", "ELU", "Log", "LRN", "Exp", "MVN",
                       "Power", "ReLU", "PReLU", "Scale", "Sigmoid", "Split", "TanH", "Threshold",
                       "Clip", "Swish"]  # fmt: skip
_LEGACY = {f"{what}_{side}" for what in ("pad", "kernel", "stride") for side in "hw"}


class UndefinedMapException(NetlibError):  # noqa: N818  pycaffe's name
    """A layer whose points do not lie anywhere in its bottoms."""


class AxisMismatchException(NetlibError):  # noqa: N818  pycaffe's name
    """Two maps from different axes on."""


class UnconnectedError(NetlibError):
    """Two tops without a common ancestor that their points can be followed to."""


class CropError(NetlibError, AssertionError):
    """Maps that no Crop layer can make equal, or options that cannot be followed."""


def conv_params(fn: Function) -> tuple[int, Array, Array, Array]:
    """Axis, stride, kernel size with its dilation, pad of a convolution, pooling or im2col. Raises CropError."""
    block = "pooling_param" if fn.type_name == "Pooling" else "convolution_param"
    params = fn.params.get(block, fn.params)
    if legacy := _LEGACY & (set(params) | set(fn.params)):
        raise CropError(
            f"a {fn.type_name} layer has {', '.join(sorted(legacy))}: cropping does not support legacy _h/_w params; "
            "write kernel_size, stride and pad, as lists if the axes differ"
        )
    if "kernel_size" not in params:
        raise UndefinedMapException(f"a {fn.type_name} layer without kernel_size has no coordinate map")
    kernel, dilation = np.array(params["kernel_size"], ndmin=1), np.array(params.get("dilation", 1), ndmin=1)
    stride, pad = np.array(params.get("stride", 1), ndmin=1), np.array(params.get("pad", 0), ndmin=1)
    return params.get("axis", 1), stride, (kernel - 1) * dilation + 1, pad


def crop_params(fn: Function) -> tuple[int, Array]:
    """Axis and offset of a Crop layer."""
    params = fn.params.get("crop_param", fn.params)
    return params.get("axis", 2), np.array(params.get("offset", 0), ndmin=1)


def coord_map(fn: Function) -> Map:
    """The map from a layer's bottoms to its tops. Raises UndefinedMapException."""
    if fn.type_name in ("Convolution", "Pooling", "Im2col"):
        axis, stride, size, pad = conv_params(fn)
        return axis, 1 / stride, (pad - (size - 1) / 2) / stride
    if fn.type_name == "Deconvolution":
        axis, stride, size, pad = conv_params(fn)
        return axis, stride, (size - 1) / 2 - pad
    if fn.type_name in PASS_THROUGH_LAYERS:
        return IDENTITY
    if fn.type_name == "Crop":
        axis, offset = crop_params(fn)
        return axis - 1, 1, -offset
    raise UndefinedMapException(f"layers of type {fn.type_name!r} have no coordinate map")


def compose(base_map: Map, next_map: Map) -> Map:
    """x -> base(next(x)). Raises AxisMismatchException."""
    axis1, a1, b1 = base_map
    axis2, a2, b2 = next_map
    if axis1 is not None and axis2 is not None and axis1 != axis2:
        raise AxisMismatchException(f"a map from axis {axis1} on cannot follow one from axis {axis2} on")
    return axis2 if axis1 is None else axis1, a1 * a2, a1 * b2 + b1


def inverse(coord_map: Map) -> Map:
    """The map back."""
    axis, a, b = coord_map
    return axis, 1 / a, -b / a


def coord_map_from_to(top_from: Top, top_to: Top) -> Map:
    """The map from the points of ``top_from`` to those of ``top_to``, by way of a layer that both come from.

    All ways to it are taken for equal. Raises UnconnectedError if there is none, AxisMismatchException, CropError.
    """
    above_from, above_to = _ancestors(top_from), _ancestors(top_to)
    for top, to_map in above_to.items():
        if top in above_from:
            return compose(to_map, inverse(above_from[top]))
    raise UnconnectedError("Could not compute map between tops; are they connected by spatial layers?")


def _ancestors(top: Top) -> dict[Top, Map]:
    """The tops that a top is computed from, as far as its points can be followed, nearest first; the maps to it."""
    maps = {top: IDENTITY}
    waiting = deque([top])
    while waiting:
        at = waiting.popleft()
        bottoms = at.fn.inputs[:1] if at.fn.type_name == "Crop" else at.fn.inputs  # Crop's other one is only a size
        try:
            step = coord_map(at.fn) if bottoms else IDENTITY
        except UndefinedMapException:
            continue
        for bottom in bottoms:
            if bottom not in maps:
                maps[bottom] = compose(maps[at], step)
                waiting.append(bottom)
    return maps


def crop(top_from: Top, top_to: Top) -> Any:
    """A Crop layer that cuts ``top_from`` to where ``top_to`` lies.

    Raises CropError if the two have different scales or the offset is negative or not whole, and what
    ``coord_map_from_to`` raises.
    """
    axis, a, b = coord_map_from_to(top_from, top_to)
    if not np.all(a == 1):
        raise CropError(f"scale mismatch on crop (a = {a}): strides and kernels must undo each other")
    if not np.all(b <= 0):
        raise CropError(f"cannot crop negative offset (b = {b}): the top to be cropped does not reach as far")
    if not np.all(np.round(b) == b):
        raise CropError(f"cannot crop noninteger offset (b = {b})")
    offset = [int(-x) for x in np.ravel(b)]
    return layers.Crop(top_from, top_to, crop_param={"axis": 2 if axis is None else axis + 1, "offset": offset})
