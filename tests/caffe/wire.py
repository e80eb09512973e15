"""A minimal reader of Caffe's binary snapshots for the tests, for the part of protobuf's wire format that they use.

A message is a sequence of fields. A field is a key (its number * 8 + wire type) and a value: a varint (type 0),
8 bytes (1), a length and its bytes (2), or 4 bytes (5). A varint has seven bits in each byte, the lowest first; the
high bit is set if another byte follows. The numbers of the fields are those of caffe.proto.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

Fields = dict[int, list[Any]]  # number -> values: int, or bytes


def fields(data: bytes) -> Fields:
    """Return the fields of one message."""
    found: Fields = {}
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        number, kind = key >> 3, key & 7
        if kind == 0:
            value, at = varint(data, at)
            found.setdefault(number, []).append(value)
            continue
        if kind == 2:
            size, at = varint(data, at)
        else:
            size = {1: 8, 5: 4}[kind]
        assert at + size <= len(data), "truncated"
        found.setdefault(number, []).append(data[at : at + size])
        at += size
    return found


def varint(data: bytes, at: int) -> tuple[int, int]:
    """Return the number that begins at a byte, and the position after it."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at


def blob(data: bytes) -> np.ndarray:
    """Read a BlobProto: data = 5 (packed floats), shape = 7 (BlobShape: dim = 1, packed varints)."""
    found = fields(data)
    sizes, shape, at = b"".join(fields(found[7][0]).get(1, [])), [], 0
    while at < len(sizes):
        size, at = varint(sizes, at)
        shape.append(size)
    values = np.frombuffer(b"".join(found[5]), "<f4")
    assert len(values) == math.prod(shape)
    return values.reshape(shape)


def read_weights(path: Path) -> dict[str, list[np.ndarray]]:
    """Read a .caffemodel: NetParameter (layer = 100), LayerParameter (name = 1, blobs = 7), also without blobs."""
    layers = [fields(layer) for layer in fields(path.read_bytes())[100]]
    return {layer[1][0].decode(): [blob(one) for one in layer.get(7, [])] for layer in layers}


def read_state(path: Path) -> tuple[int, int, str, list[np.ndarray]]:
    """Read a .solverstate: iter = 1, current_step = 4, learned_net = 2, history = 3."""
    found = fields(path.read_bytes())
    return found[1][0], found[4][0], found[2][0].decode(), [blob(one) for one in found[3]]
