"""What several chapters of the book need: one layer run on arrays, and the numbers that
Caffe computed.

from docs.book.helpers import run, against_caffe
[bottom], [top] = run(layer, x, dy=dy)
against_caffe("relu")
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import netlib
from netlib import Blob
from tests.caffe import recorded as recordings

# (ours, Caffe's): the largest difference, relative to the largest number
relative = recordings.relative


class Followed(NamedTuple):
    """A training run next to Caffe's: the updates compared, the largest relative differences of
    weights and losses.
    """

    updates: int
    weights: float
    losses: float


def run(layer: netlib.Layer, *inputs: Any, dy: Any = None) -> tuple[list[Blob], list[Blob]]:
    """Run a layer once on arrays, in float64: forward, and backward if ``dy``, the gradient of its
    top, is given.

    Returns its bottoms and its top, as lists of blobs.
    """
    arrays = [np.asarray(x, dtype=np.float64) for x in inputs]
    bottom, top = [Blob(x.shape, np.float64) for x in arrays], [Blob((), np.float64)]
    for blob, x in zip(bottom, arrays):
        blob.data[...] = x
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    if dy is not None:
        top[0].diff[...] = dy
        layer.backward(top, [True] * len(bottom), bottom)
    return bottom, top


def caffe_cases(prefix: str = "") -> list[str]:
    """The names of the small nets that were run in Caffe, those that begin with ``prefix``."""
    return [case.name for case in recordings.layer_cases() if case.name.startswith(prefix)]


def against_caffe(name: str) -> dict[str, float]:
    """Run one of these nets here, in float64: for each array the largest difference from Caffe's,
    relative to the largest number. Raises KeyError for an unknown name.
    """
    cases = {case.name: case for case in recordings.layer_cases()}
    return recordings.differences(cases[name], np.float64)


def caffe_arrays(name: str) -> dict[str, np.ndarray]:
    """The inputs and results of a layer of the paper, as the released C++ computed
    them in Caffe.
    """
    with np.load(recordings.FOLDER / f"{name}.npz") as file:
        return dict(file)


def caffe_runs() -> list[str]:
    """The names of the training runs that were recorded in Caffe."""
    return list(recordings.solver_cases())


def follow_caffe(name: str, iterations: int = 20) -> Followed:
    """Repeat one of these runs from Caffe's first weights."""
    folder = recordings.FOLDER / "solvers"
    solver = netlib.get_solver(folder / f"solver_{name}.prototxt", snapshot=0)
    solver.copy_weights(folder / "init.caffemodel.h5")
    followed = recordings.Follow(solver, recordings.trajectory(name))
    solver.step(iterations)
    return Followed(followed.updates, followed.worst, followed.worst_loss)
