"""Two of Caffe's binary messages: Datum, one entry of a database, and BlobProto, the file of a mean image.

They are protocol buffers: a message is a row of fields, a field is a key (its number * 8 + its wire type) and a value.
Wire type 0 is a varint (seven bits in each byte, the lowest first; the high bit says that another byte follows), 1 are
8 bytes, 5 are 4 bytes, 2 is a length and so many bytes. The numbers of the fields are those of caffe.proto.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from layers.data.images import decode_image, planes
from netlib.blob import Array
from netlib.errors import DataError, reason_of

Fields = dict[int, list[int | bytes]]  # number -> values


def decode_datum(data: bytes, color: bool | None, what: str) -> tuple[Array, int]:
    """The values (C, H, W) and the label of a Datum: bytes, floats or an encoded picture. Raises DataError.

    ``color`` is how to decode a picture: True in colour, False in grey, None as it is.
    """
    fields = _fields(data, what)
    label = _integer(fields, 5)
    content = _bytes(fields, 4, what)
    if _integer(fields, 7):
        return planes(decode_image(content, color, what)), label
    shape = tuple(_integer(fields, number) for number in (1, 2, 3))
    values = np.frombuffer(content, np.uint8) if content else _floats(fields, 6, "<f4", what)
    if min(shape) < 1 or len(values) != math.prod(shape):
        raise DataError(f"{what}: a Datum of channels, height, width {shape} with {len(values)} values")
    return values.reshape(shape), label


def read_blob(path: Path) -> Array:
    """The values of a BlobProto in a file. Raises DataError."""
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot read the blob: {reason_of(error)}") from error
    fields, what = _fields(content, str(path)), str(path)
    if {1, 2, 3, 4} & set(fields):  # older than shape
        shape = [_integer(fields, number) for number in (1, 2, 3, 4)]
    else:
        sizes = _fields(_bytes(fields, 7, what), what).get(1, [])
        shape = [size for part in sizes for size in ([part] if isinstance(part, int) else _varints(part, what))]
    values = _floats(fields, 8, "<f8", what) if 8 in fields else _floats(fields, 5, "<f4", what)
    if min(shape, default=0) < 0 or len(values) != math.prod(shape):
        raise DataError(f"{path}: not a blob (.binaryproto): of shape {tuple(shape)}, but with {len(values)} values")
    return values.reshape(shape)


# ---------------------------------------------------------------------------------------------- the wire format


def _fields(data: bytes, what: str) -> Fields:
    found: Fields = {}
    at = 0
    while at < len(data):
        key, at = _varint(data, at, what)
        number, kind = key >> 3, key & 7
        if kind == 0:
            value, at = _varint(data, at, what)
            found.setdefault(number, []).append(value)
            continue
        if kind == 2:
            size, at = _varint(data, at, what)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise DataError(f"{what}: not a message of Caffe's: wire type {kind} before byte {at}")
        if at + size > len(data):
            raise DataError(f"{what}: truncated: field {number} has {size} bytes, but {len(data) - at} are left")
        found.setdefault(number, []).append(data[at : at + size])
        at += size
    return found


def _varint(data: bytes, at: int, what: str) -> tuple[int, int]:
    """The number that begins at a byte, and where the next one begins."""
    value = 0
    for place, byte in enumerate(data[at : at + 10]):
        value |= (byte & 127) << 7 * place
        if byte < 128:
            return value, at + place + 1
    reason = (
        "truncated: it ends within a number" if at + 10 > len(data) else "not a message: a number of over ten bytes"
    )
    raise DataError(f"{what}: {reason} at byte {at}")


def _varints(data: bytes, what: str) -> list[int]:
    """Several in a row."""
    found, at = [], 0
    while at < len(data):
        value, at = _varint(data, at, what)
        found.append(value)
    return found


def _integer(fields: Fields, number: int) -> int:
    """An int32, by default 0; the last one if there are several."""
    value = fields.get(number, [0])[-1]
    low = value & 0xFFFFFFFF if isinstance(value, int) else 0
    return low - 2**32 if low >= 2**31 else low


def _bytes(fields: Fields, number: int, what: str) -> bytes:
    value = fields.get(number, [b""])[-1]
    if isinstance(value, int):
        raise DataError(f"{what}: not a message of Caffe's: field {number} is a number")
    return value


def _floats(fields: Fields, number: int, dtype: str, what: str) -> Array:
    """Numbers in one piece ("packed") or one by one."""
    content = b"".join(part for part in fields.get(number, []) if isinstance(part, bytes))
    if len(content) % np.dtype(dtype).itemsize:
        raise DataError(f"{what}: not a message of Caffe's: field {number} has {len(content)} bytes of numbers")
    return np.frombuffer(content, dtype)
