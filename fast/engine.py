"""The fast engine: what it does in its own way, and the table of its classes.

A fast class is a plain class with its computation replaced. It inherits setup, reshape, options and messages, and
leaves options that it cannot serve to the plain layer.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import DTypeLike

from fast import parallel
from fast.augment import FastHandAugment
from fast.convolution import FastConvolution
from fast.executor import SlicedExecutor
from fast.hdf5_data import FastHDF5Data
from fast.inner_product import FastInnerProduct
from fast.kinematics import FastHandModel, FastKinematics, FastSizedHandModel
from fast.pooling import FastPooling
from fast.relu import FastReLU
from fast.tiles import FastBlob
from layers.activation.relu import ReLU
from layers.common.inner_product import InnerProduct
from layers.data.hdf5_data import HDF5Data
from layers.hand.augment import HandAugment
from layers.hand.hand_model import HandModel
from layers.hand.kinematics import Kinematics
from layers.hand.sized_hand_model import SizedHandModel
from layers.vision.convolution import Convolution
from layers.vision.pooling import Pooling
from netlib.blob import Array, Blob
from netlib.engine.plain import Connection, Engine, Executor
from netlib.system.memory import blocks

T = TypeVar("T")
LARGE = 1 << 20  # bytes from which a copy takes longer than handing it out (some 0.1 ms)
COPIES = 16  # parts of a large copy, for up to as many threads

FAST_CLASSES: dict[type, type] = {
    Convolution: FastConvolution,
    HandAugment: FastHandAugment,
    HandModel: FastHandModel,
    HDF5Data: FastHDF5Data,
    InnerProduct: FastInnerProduct,
    Kinematics: FastKinematics,
    Pooling: FastPooling,
    ReLU: FastReLU,
    SizedHandModel: FastSizedHandModel,
}


class FastEngine(Engine):
    """Slices of the batch on several threads, own classes for the layers that cost most."""

    name = "fast"

    def implementation(self, cls: type[T]) -> type[T]:
        """The fast class for ``cls``, otherwise ``cls``."""
        return FAST_CLASSES.get(cls, cls)

    def blob(self, dtype: DTypeLike) -> Blob:
        """One that can be hidden."""
        return FastBlob((), dtype)

    def executor(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> Executor:
        """Slices where that pays."""
        return SlicedExecutor(connections, outside, name)

    def run(self, jobs: Sequence[Callable[[], None]]) -> None:
        """On all threads."""
        parallel.run(jobs)

    def copy(self, source: Array, target: Array) -> None:
        """On all threads if it is large; parts of arrays that share memory would overwrite each other's sources."""
        if target.nbytes < LARGE or np.may_share_memory(source, target):
            target[...] = source
            return

        def job(rows: slice) -> None:
            target[rows] = source[rows]

        parallel.run([functools.partial(job, rows) for rows in blocks(len(target), -(-len(target) // COPIES))])

    def threads(self) -> int:
        """Of the one pool (parallel.py)."""
        return parallel.threads()

    def set_threads(self, count: int) -> None:
        """Of the one pool (parallel.py)."""
        parallel.set_threads(count)
