"""Datum: one entry of Caffe's databases, an image and its label."""

from __future__ import annotations

import math

import numpy as np

from layers.data.images import decode_image, planes
from netlib.blob import Array
from netlib.errors import DataError, WireError
from netlib.proto import schema, wire
from netlib.proto.messages import Datum


def decode_datum(data: bytes, color: bool | None, what: str) -> tuple[Array, int]:
    """Decode values (C, H, W) and label of a Datum: bytes, floats or an encoded image. Raises DataError.

    ``color`` selects how images are decoded: True in colour, False in grey, None unchanged.
    """
    try:
        datum = schema.read(wire.decode(data, Datum, what), Datum)
    except WireError as error:
        raise DataError(f"{error}; expected a Datum") from None
    if datum.encoded:
        return planes(decode_image(datum.data, color, what)), datum.label
    shape = datum.channels, datum.height, datum.width
    values = np.frombuffer(datum.data, np.uint8) if datum.data else datum.float_data
    count = 0 if values is None else len(values)
    if values is None or min(shape) < 1 or count != math.prod(shape):
        raise DataError(f"{what}: a Datum with channels, height, width {shape} has {count} values")
    return values.reshape(shape), datum.label
