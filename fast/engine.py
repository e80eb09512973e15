"""The fast engine: the overridden methods of the engine interface, and the table of fast
layer classes.

A fast class is a subclass of a plain class with another computation. It inherits setup, reshape,
options and messages, and calls the plain computation for options that it does not support.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import TypeVar

import numpy as np
from numpy.typing import DTypeLike

from fast import parallel
from fast.fast_layer import FastLayer
from fast.fusing import fuse, release
from fast.parallel import equal_blocks
from fast.plan import plan
from fast.slices import SlicedStep
from fast.whole_steps import FastStep, WholeStep, whole_steps
from netlib.blob import Array, Blob
from netlib.building.splits import share_splits
from netlib.engine import Connection, Engine, Step
from netlib.proto.options import class_at, place_of

T = TypeVar("T")
LARGE = 1 << 20  # bytes; larger copies take longer than starting jobs on threads (about 0.1 ms)
COPIES = 16  # parts of a large copy, and so the maximum number of threads that share it

# The places of plain classes in layers/ and of their fast classes here; files are imported when a
# net needs them.
FAST_CLASSES: dict[str, str] = {
    "activation.relu.ReLU": "relu.FastReLU",
    "activation.relu6.ReLU6": "relu.FastReLU6",
    "activation.scale.Scale": "per_channel.FastScale",
    "common.inner_product.InnerProduct": "inner_product.FastInnerProduct",
    "hand.augment.HandAugment": "augment.FastHandAugment",
    "hand.hand_model.HandModel": "kinematics.FastHandModel",
    "hand.kinematics.Kinematics": "kinematics.FastKinematics",
    "hand.sized_hand_model.SizedHandModel": "kinematics.FastSizedHandModel",
    "normalization.batch_norm.BatchNorm": "per_channel.FastBatchNorm",
    "vision.convolution.Convolution": "convolution.FastConvolution",
    "vision.deconvolution.Deconvolution": "convolution.FastDeconvolution",
    "vision.depthwise_convolution.ConvolutionDepthwise": "convolution.FastConvolutionDepthwise",
    "vision.depthwise_convolution.DepthwiseConvolution": "convolution.FastDepthwiseConvolution",
    "vision.pooling.Pooling": "pooling.FastPooling",
}


class FastEngine(Engine):
    """Engine that runs slices of the batch on several threads, with fast classes for the most
    expensive layers.
    """

    name = "fast"

    def implementation(self, cls: type[T]) -> type[T]:
        """The fast class for ``cls``, or ``cls`` if there is none."""
        place = FAST_CLASSES.get(place_of(cls))
        fast: type[T] = cls if place is None else class_at("fast", place)
        return fast if issubclass(fast, cls) else cls  # a user's class may have the same name

    def blob(self, dtype: DTypeLike) -> Blob:
        """Create a blob of a net, with aligned arrays."""
        return Blob((), dtype, parallel.zeros_for_blob)

    def steps(
        self, connections: Sequence[Connection], outside: Iterable[Blob], old: Sequence[Step]
    ) -> Sequence[Step]:
        """The steps of a net: layers that run in slices together (plan.py), and other layers on
        the whole batch.
        """
        for at in connections:
            if isinstance(at.layer, FastLayer):
                at.layer.needs_backward = at.needs_backward
                at.layer.needs_bottom_diff = any(at.propagate_down)
        stored = set(outside)
        fuse(connections, stored)
        runs = plan(connections, stored)
        sliced = [at for run in runs if run.sliced for at in run.connections]
        share_splits(connections, sliced)
        blobs = {blob for at in connections for blob in at.blobs}
        new: list[FastStep] = []
        for is_sliced, part in groupby(runs, lambda run: run.sliced):
            if is_sliced:
                new += [SlicedStep(run) for run in part]
            else:
                new += whole_steps([at for run in part for at in run.connections], blobs)
        known = {step.key: step for step in old if isinstance(step, FastStep)}
        return [known.get(step.key, step) for step in new]

    def steps_by_layer(self, connections: Sequence[Connection]) -> Sequence[Step]:
        """A step for each layer, on the whole batch; no layer is computed with another."""
        for at in connections:
            if isinstance(at.layer, FastLayer) and at.layer.is_fused:
                at.layer.take_memory()
        release(connections)
        return [WholeStep(at) for at in connections]

    def run(self, jobs: Sequence[Callable[[], None]], values: float = float("inf")) -> None:
        """Run independent jobs, on all threads if they process many values, and return
        when all are done.
        """
        parallel.run(jobs, here=values < LARGE // 4)

    def copy(self, source: Array, target: Array) -> None:
        """Copy an array; large ones on all threads, unless the arrays share memory: parts could
        overwrite sources.
        """
        if target.nbytes < LARGE or np.may_share_memory(source, target):
            target[...] = source
            return

        def job(rows: slice) -> None:
            target[rows] = source[rows]

        parts = equal_blocks(len(target), COPIES)
        parallel.run([functools.partial(job, rows) for rows in parts])

    def threads(self) -> int:
        """Number of threads in use, all from the pool in parallel.py."""
        return parallel.threads()

    def set_threads(self, count: int) -> None:
        """Set the number of threads of the pool in parallel.py."""
        parallel.set_threads(count)
