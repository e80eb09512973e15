"""What real Caffe computed, as much of it as the exercises need: recorded.npz, reduced from tests/caffe.

``python -m tests.exercises.reduce_recordings`` made it. Arrays of a layer are CASE/KIND/NUMBER: ``in`` and
``param`` are what the layer was given, ``top`` what it made of them, ``topdiff`` what backward began with, ``indiff``
and ``pdiff`` what it made of that. The others are named where they are used.
"""

from __future__ import annotations

import functools
import io
from pathlib import Path

import numpy as np

from netlib import files
from netlib.blob import Array

FILE = Path(__file__).with_name("recorded.npz")


@functools.cache
def everything() -> dict[str, Array]:
    """All arrays by name. Raises DataError if the file cannot be read."""
    content = files.read_bytes(FILE, "the recorded numbers")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def of_layer(case: str, kind: str) -> list[Array]:
    """The arrays of one kind, in order; none if Caffe's layer has none."""
    arrays = everything()
    found: list[Array] = []
    while (name := f"{case}/{kind}/{len(found)}") in arrays:
        found.append(arrays[name])
    return found
