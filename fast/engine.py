"""The fast engine: the overridden methods of the engine interface, and the table of fast layer classes.

A fast class is a subclass of a plain class with another computation. It inherits setup, reshape, options and messages,
and calls the plain computation for options that it does not support.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import DTypeLike

from fast import aligned, parallel
from fast.executor import SlicedExecutor
from netlib.blob import Array, Blob
from netlib.building.layer_table import class_at, place_of
from netlib.engine.plain import Connection, Engine, Executor
from netlib.system.memory import blocks

T = TypeVar("T")
LARGE = 1 << 20  # bytes; larger copies take longer than starting jobs on threads (about 0.1 ms)
COPIES = 16  # parts of a large copy, and so the maximum number of threads that share it

# The places of plain classes in layers/ and of their fast classes here; files are imported when a net needs them.
FAST_CLASSES: dict[str, str] = {
    "activation.relu.ReLU": "relu.FastReLU",
    "activation.relu6.ReLU6": "relu.FastReLU6",
    "activation.scale.Scale": "per_channel.FastScale",
    "common.inner_product.InnerProduct": "inner_product.FastInnerProduct",
    "data.hdf5_data.HDF5Data": "hdf5_data.FastHDF5Data",
    "hand.augment.HandAugment": "augment.FastHandAugment",
    "hand.hand_model.HandModel": "kinematics.FastHandModel",
    "hand.kinematics.Kinematics": "kinematics.FastKinematics",
    "hand.sized_hand_model.SizedHandModel": "kinematics.FastSizedHandModel",
    "normalization.batch_norm.BatchNorm": "batch_norm.FastBatchNorm",
    "vision.convolution.Convolution": "convolution.FastConvolution",
    "vision.deconvolution.Deconvolution": "convolution.FastDeconvolution",
    "vision.depthwise_convolution.ConvolutionDepthwise": "convolution.FastConvolutionDepthwise",
    "vision.depthwise_convolution.DepthwiseConvolution": "convolution.FastDepthwiseConvolution",
    "vision.pooling.Pooling": "pooling.FastPooling",
}


class FastEngine(Engine):
    """Engine that runs slices of the batch on several threads, with fast classes for the most expensive layers."""

    name = "fast"

    def implementation(self, cls: type[T]) -> type[T]:
        """The fast class for ``cls``, or ``cls`` if there is none."""
        place = FAST_CLASSES.get(place_of(cls))
        fast: type[T] = cls if place is None else class_at("fast", place)
        return fast if issubclass(fast, cls) else cls  # a user's class may have the same name

    def blob(self, dtype: DTypeLike) -> Blob:
        """Create a blob of a net, with aligned arrays."""
        return Blob((), dtype, aligned.zeros_for_blob)

    def executor(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> Executor:
        """Create an executor that runs layers in slices where this is faster."""
        return SlicedExecutor(connections, outside, name)

    def run(self, jobs: Sequence[Callable[[], None]]) -> None:
        """Run independent jobs on all threads and return when all are done."""
        parallel.run(jobs)

    def copy(self, source: Array, target: Array) -> None:
        """Copy an array; large ones on all threads, unless the arrays share memory: parts could overwrite sources."""
        if target.nbytes < LARGE or np.may_share_memory(source, target):
            target[...] = source
            return

        def job(rows: slice) -> None:
            target[rows] = source[rows]

        parallel.run([functools.partial(job, rows) for rows in blocks(len(target), -(-len(target) // COPIES))])

    def threads(self) -> int:
        """Number of threads in use, all from the pool in parallel.py."""
        return parallel.threads()

    def set_threads(self, count: int) -> None:
        """Set the number of threads of the pool in parallel.py."""
        parallel.set_threads(count)
