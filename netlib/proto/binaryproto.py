"""Blobs in Caffe's binary files: conversion to and from BlobProto, and .binaryproto files
for mean images.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, WireError
from netlib.files import reading
from netlib.files.atomic import replace_bytes
from netlib.proto import schema, wire
from netlib.proto.messages import BlobProto, BlobShape
from netlib.proto.prototxt import Message

RAW: dict[str, np.dtype[Any]] = {
    "DOUBLE": np.dtype("<f8"),
    "FLOAT": np.dtype("<f4"),
    "FLOAT16": np.dtype("<f2"),
}
# the form of a shape that is older than the field ``shape``
AXES = ("num", "channels", "height", "width")


def array_of(proto: BlobProto) -> Array:
    """The values of a BlobProto, in its precision, as a view of the file's bytes; half precision
    becomes single. Raises WireError.

    Blobs older than the field ``shape`` have four axes; if both are present, these take
    precedence, as in Caffe.
    """
    shape: tuple[int, ...] = tuple(getattr(proto, axis) for axis in AXES)
    if proto.shape is not None and not any(schema.is_given(proto, axis) for axis in AXES):
        shape = proto.shape.dim
    given = [
        values for values in (proto.data, proto.double_data) if values is not None and values.size
    ]
    values: Array = given[-1] if given else _raw_values(proto)
    if min(shape, default=0) < 0 or math.prod(shape) != values.size:
        raise WireError(
            f"{schema.position_of(proto)}: a blob of shape {shape} has {values.size} values"
        )
    return values.reshape(shape)


def _raw_values(proto: BlobProto) -> Array:
    """The values of ``raw_data``, in which NVIDIA's Caffe and OpenCV's shrinkCaffeModel write
    half precision.
    """
    kind = RAW[proto.raw_data_type]
    if len(proto.raw_data) % kind.itemsize:
        raise WireError(
            f"{schema.position_of(proto)}: {len(proto.raw_data)} bytes of raw_data are no {kind.name} "
            "array"
        )
    values = np.frombuffer(proto.raw_data, kind)
    return values if kind.itemsize > 2 and values.size else values.astype(np.float32)


def tree_of(array: Array, diff: Array | None = None, older: bool = False) -> Message:
    """Convert an array, and its gradient if given, to a BlobProto tree; float64 as double, other
    types as float.

    ``older``: the four axes are written as num, channels, height and width.
    """
    flat = np.ravel(array)
    slope = None if diff is None else np.ravel(diff)
    shape: dict[str, Any] = (
        dict(zip(AXES, array.shape)) if older else {"shape": BlobShape(array.shape)}
    )
    if array.dtype == np.float64:
        return schema.to_tree(BlobProto(double_data=flat, double_diff=slope, **shape))
    slope = None if slope is None else slope.astype(np.float32, copy=False)
    return schema.to_tree(BlobProto(data=flat.astype(np.float32, copy=False), diff=slope, **shape))


def read_blob(path: str | Path) -> Array:
    """Read the array in a .binaryproto file. Raises DataError."""
    data = files.read_bytes(path, "the blob")
    try:
        proto = schema.read(wire.decode(data, BlobProto, str(path)), BlobProto)
        array = array_of(proto)
    except WireError as error:
        raise DataError(f"{error}; expected a blob (.binaryproto)") from error
    if not array.size:
        raise DataError(f"{path}: it holds no values; expected a blob (.binaryproto)")
    return array


def write_blob(array: Array, path: str | Path) -> None:
    """Write a .binaryproto file atomically; four axes in the older form, as Caffe's
    compute_image_mean does.

    Raises DataError.
    """
    array = np.asarray(array)
    image = wire.encode(tree_of(array, older=array.ndim == 4), BlobProto)
    with reading.refused(path, "the blob", verb="write"):
        replace_bytes(Path(path), image)
