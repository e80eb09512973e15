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

from fast import parallel
from fast.augment import FastHandAugment
from fast.convolution import (
    FastConvolution,
    FastConvolutionDepthwise,
    FastDeconvolution,
    FastDepthwiseConvolution,
)
from fast.eltwise import FastEltwise
from fast.executor import SlicedExecutor
from fast.hdf5_data import FastHDF5Data
from fast.inner_product import FastInnerProduct
from fast.kinematics import FastHandModel, FastKinematics, FastSizedHandModel
from fast.lrn import FastLRN
from fast.per_channel import FastBatchNorm, FastBias, FastPReLU, FastScale
from fast.pooling import FastPooling
from fast.relu import FastReLU, FastReLU6
from fast.tiles import FastBlob
from layers.activation.bias import Bias
from layers.activation.prelu import PReLU
from layers.activation.relu import ReLU
from layers.activation.relu6 import ReLU6
from layers.activation.scale import Scale
from layers.common.eltwise import Eltwise
from layers.common.inner_product import InnerProduct
from layers.data.hdf5_data import HDF5Data
from layers.hand.augment import HandAugment
from layers.hand.hand_model import HandModel
from layers.hand.kinematics import Kinematics
from layers.hand.sized_hand_model import SizedHandModel
from layers.normalization.batch_norm import BatchNorm
from layers.normalization.lrn import LRN
from layers.vision.convolution import Convolution
from layers.vision.deconvolution import Deconvolution
from layers.vision.depthwise_convolution import ConvolutionDepthwise, DepthwiseConvolution
from layers.vision.pooling import Pooling
from netlib.blob import Array, Blob
from netlib.engine.plain import Connection, Engine, Executor
from netlib.system.memory import blocks

T = TypeVar("T")
LARGE = 1 << 20  # bytes; larger copies take longer than starting jobs on threads (about 0.1 ms)
COPIES = 16  # parts of a large copy, and so the maximum number of threads that share it

FAST_CLASSES: dict[type, type] = {
    BatchNorm: FastBatchNorm,
    Bias: FastBias,
    Convolution: FastConvolution,
    ConvolutionDepthwise: FastConvolutionDepthwise,
    Deconvolution: FastDeconvolution,
    DepthwiseConvolution: FastDepthwiseConvolution,
    Eltwise: FastEltwise,
    HandAugment: FastHandAugment,
    HandModel: FastHandModel,
    HDF5Data: FastHDF5Data,
    InnerProduct: FastInnerProduct,
    Kinematics: FastKinematics,
    LRN: FastLRN,
    PReLU: FastPReLU,
    Pooling: FastPooling,
    ReLU: FastReLU,
    ReLU6: FastReLU6,
    Scale: FastScale,
    SizedHandModel: FastSizedHandModel,
}


class FastEngine(Engine):
    """Engine that runs slices of the batch on several threads, with fast classes for the most expensive layers."""

    name = "fast"

    def implementation(self, cls: type[T]) -> type[T]:
        """The fast class for ``cls``, or ``cls`` if there is none."""
        return FAST_CLASSES.get(cls, cls)

    def blob(self, dtype: DTypeLike) -> Blob:
        """Create a blob that can be hidden."""
        return FastBlob((), dtype)

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
