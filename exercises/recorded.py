"""Results recorded from real Caffe, as far as the exercises need them: recorded.npz, reduced
from tests/caffe.

``python -m tests.exercises.reduce_recordings`` generates it. Arrays of a layer are
CASE/KIND/NUMBER: ``in`` and ``param`` are the inputs and parameters, ``top`` the outputs,
``topdiff`` the input of backward, ``indiff`` and ``pdiff`` its results. The other arrays are named
where they are used.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from netlib.blob import Array

FILE = Path(__file__).with_name("recorded.npz")


@functools.cache
def everything() -> dict[str, Array]:
    """Return all arrays by name."""
    with np.load(FILE, allow_pickle=False) as arrays:
        return dict(arrays)


def of_layer(case: str, kind: str) -> list[Array]:
    """Return the arrays of one kind, in order; empty if Caffe's layer has none."""
    arrays = everything()
    found: list[Array] = []
    while (name := f"{case}/{kind}/{len(found)}") in arrays:
        found.append(arrays[name])
    return found
