"""Write Caffe's binary messages for tests, byte by byte as in protocol buffers, and LMDB
databases of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np


def varint(number: int) -> bytes:
    """Return a varint: seven bits in each byte, the lowest first; a negative number as 64 bits."""
    number %= 2**64
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def number(field: int, value: int) -> bytes:
    """Return a field that is a number."""
    return varint(field << 3) + varint(value)


def content(field: int, value: bytes) -> bytes:
    """Return a field that is a string, a message, or packed numbers."""
    return varint(field << 3 | 2) + varint(len(value)) + value


def datum(image: np.ndarray | bytes, label: int) -> bytes:
    """Return a Datum: an image (C, H, W) of bytes or floats, or the bytes of a picture file."""
    if isinstance(image, bytes):
        return content(4, image) + number(5, label) + number(7, 1)
    shape = b"".join(number(field, size) for field, size in zip((1, 2, 3), image.shape))
    if image.dtype == np.uint8:
        return shape + content(4, image.tobytes()) + number(5, label)
    # not packed
    floats = [varint(6 << 3 | 5) + np.float32(value).tobytes() for value in np.ravel(image)]
    return shape + number(5, label) + b"".join(floats)


def write_blob(path: Path, values: np.ndarray) -> Path:
    """Write a mean file: a BlobProto of floats or doubles."""
    shape = content(7, content(1, b"".join(map(varint, values.shape))))
    field, dtype = (8, "<f8") if values.dtype == np.float64 else (5, "<f4")
    path.write_bytes(content(field, values.astype(dtype).tobytes()) + shape)
    return path


def write_database(folder: Path, entries: Iterable[bytes]) -> Path:
    """Write an LMDB database of entries ``00000000 -> bytes``."""
    import lmdb

    with lmdb.open(str(folder), map_size=1 << 20) as database, database.begin(write=True) as change:
        for i, entry in enumerate(entries):
            change.put(f"{i:08}".encode(), entry)
    return folder
