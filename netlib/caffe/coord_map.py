"""caffe.coord_map: coordinate maps between tops, through the layers that connect them.

A map is (axis, a, b): a point x maps to a * x + b. It applies to the axes after ``axis``, the one
before the first spatial axis. ``a`` and ``b`` are arrays with one number per spatial axis, or one
number for all. (None, 1, 0) is the identity. The purpose is ``crop``, which aligns an upsampled top
with another one.
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

PASS_THROUGH_LAYERS = [
    "AbsVal",
    "BatchNorm",
    "Bias",
    "BNLL",
    "Dropout",
    "Eltwise",
    "ELU",
    "Log",
    "LRN",
    "Exp",
    "MVN",
    "Power",
    "ReLU",
    "PReLU",
    "Scale",
    "Sigmoid",
    "Split",
    "TanH",
    "Threshold",
    "Clip",
    "Swish",
]
_LEGACY = {f"{what}_{side}" for what in ("pad", "kernel", "stride") for side in "hw"}


class UndefinedMapException(NetlibError):  # noqa: N818  pycaffe's name
    """A layer without a coordinate map."""


class AxisMismatchException(NetlibError):  # noqa: N818  pycaffe's name
    """Two maps that apply to different axes."""


class UnconnectedError(NetlibError):
    """Two tops without a common ancestor connected by coordinate maps."""


class CropError(NetlibError, AssertionError):
    """Maps that a Crop layer cannot align, or options without a coordinate map."""


def conv_params(fn: Function) -> tuple[int, Array, Array, Array]:
    """Axis, stride, dilated kernel size and pad of a convolution, pooling or im2col.

    Raises CropError.
    """
    block = "pooling_param" if fn.type_name == "Pooling" else "convolution_param"
    params = fn.params.get(block, fn.params)
    if legacy := _LEGACY & (set(params) | set(fn.params)):
        raise CropError(
            f"a {fn.type_name} layer has {', '.join(sorted(legacy))}: cropping does not support legacy _h/_w params; "
            "write kernel_size, stride and pad, as lists if the axes differ"
        )
    if "kernel_size" not in params:
        raise UndefinedMapException(
            f"a {fn.type_name} layer without kernel_size has no coordinate map"
        )
    defaults = {"kernel_size": 1, "dilation": 1, "stride": 1, "pad": 0}
    kernel, dilation, stride, pad = (
        np.array(params.get(name, default), ndmin=1) for name, default in defaults.items()
    )
    return params.get("axis", 1), stride, (kernel - 1) * dilation + 1, pad


def crop_params(fn: Function) -> tuple[int, Array]:
    """Return axis and offset of a Crop layer."""
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
    """Compose maps: x -> base(next(x)). Raises AxisMismatchException."""
    axis1, a1, b1 = base_map
    axis2, a2, b2 = next_map
    if axis1 is not None and axis2 is not None and axis1 != axis2:
        raise AxisMismatchException(
            f"a map from axis {axis1} on cannot follow one from axis {axis2} on"
        )
    return axis2 if axis1 is None else axis1, a1 * a2, a1 * b2 + b1


def inverse(coord_map: Map) -> Map:
    """Invert a map."""
    axis, a, b = coord_map
    return axis, 1 / a, -b / a


def coord_map_from_to(top_from: Top, top_to: Top) -> Map:
    """The map from points of ``top_from`` to points of ``top_to`` through a common ancestor.

    All paths are assumed to be equivalent. Raises UnconnectedError if there is none,
    AxisMismatchException, CropError.
    """
    above_from = _ancestors(top_from)
    above_to = _ancestors(top_to)
    for top, to_map in above_to.items():
        if top in above_from:
            return compose(to_map, inverse(above_from[top]))
    raise UnconnectedError(
        "Could not compute map between tops; are they connected by spatial layers?"
    )


def _ancestors(top: Top) -> dict[Top, Map]:
    """Ancestors of a top as far as coordinate maps exist, nearest first, with the
    maps to the top.
    """
    maps = {top: IDENTITY}
    waiting = deque([top])
    while waiting:
        at = waiting.popleft()
        # the second bottom of a Crop only gives a size
        bottoms = at.fn.inputs[:1] if at.fn.type_name == "Crop" else at.fn.inputs
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
    """Create a Crop layer that aligns ``top_from`` with ``top_to``.

    Raises CropError if the scales differ or the offset is negative or fractional, and the errors of
    ``coord_map_from_to``.
    """
    axis, a, b = coord_map_from_to(top_from, top_to)
    if not np.all(a == 1):
        raise CropError(
            f"scale mismatch on crop (a = {a}): strides and kernels must undo each other"
        )
    if not np.all(b <= 0):
        raise CropError(
            f"cannot crop negative offset (b = {b}): the top to be cropped is too small"
        )
    if not np.all(np.round(b) == b):
        raise CropError(f"cannot crop noninteger offset (b = {b})")
    offset = [int(-x) for x in np.ravel(b)]
    return layers.Crop(
        top_from, top_to, crop_param={"axis": 2 if axis is None else axis + 1, "offset": offset}
    )
