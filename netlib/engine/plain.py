"""The plain engine: runs each layer once on the whole batch, forwards in the order of the file, backwards in reverse.

An engine decides which class computes a layer type, which blobs a net has, in which order layers run, and how
independent jobs are run. This module defines the interface; the fast engine (fast/engine.py) overrides its methods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import DTypeLike

from netlib.blob import Array, Blob, Blobs
from netlib.engine.checks import check_memory, guarded, run_backward
from netlib.engine.passes import ForwardRecord
from netlib.layer import Layer
from netlib.system.one_thread import OneThread

T = TypeVar("T")
BackwardHook = Callable[["Layer | None"], None]
"""Called during a backward pass: with a layer once it and all later layers are done, and with None in between."""


@dataclass(eq=False)  # each is its own key
class Connection:
    """A layer of a net with its bottom and top blobs."""

    layer: Layer
    bottom: Blobs
    top: Blobs
    propagate_down: list[bool]
    needs_backward: bool = False
    has_run_back: bool = False


class Step:
    """One layer, run on the whole batch."""

    def __init__(self, at: Connection) -> None:
        self.at = at

    def forward(self) -> None:
        """Reshape the tops and compute them."""
        guarded(self.at.layer, "reshape", self.at.bottom, self.at.top)
        guarded(self.at.layer, "forward", self.at.bottom, self.at.top)

    def backward(self, on_done: BackwardHook | None = None) -> None:
        """Compute the diffs, if needed. ``on_done`` may be called with None, in this thread."""
        if self.at.needs_backward:
            run_backward(self.at)

    def clear(self) -> None:
        """Prepare ``backward`` without ``forward``: what forward would store for it is zero, as in Caffe."""
        if self.at.needs_backward:
            guarded(self.at.layer, "clear", self.at.bottom, self.at.top)

    def pieces(self) -> list[list[Connection]]:
        """The layers in execution order, for a timer: one list per shard of the batch; this engine has one shard."""
        return [[self.at]]


class Executor:
    """Runs the layers of a net.

    ``connections`` are its layers in the order of the file. ``outside`` are the blobs that a caller reads or writes:
    inputs, outputs, losses; the fast engine may not store others. ``name`` is the name of the net. If a second thread
    uses the executor at the same time, ``one_thread`` raises NetlibError.
    """

    def __init__(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> None:
        self.connections = list(connections)
        self.one_thread = OneThread(name)
        self._fits = False  # whether the check for memory has passed
        self._outside = list(outside)
        self.record = ForwardRecord(self.connections)
        self.steps: Sequence[Step] = [Step(at) for at in connections]

    def forward(self, first: int = 0, last: int | None = None) -> None:
        """Run the layers from ``first`` up to but not including ``last`` forwards."""
        with self.one_thread, np.errstate(all="ignore"):  # the solver reports values that are not finite
            if not self._fits and (first, last) == (0, None):
                check_memory(self.connections, self.hidden())
                self._fits = True
            for step in self.in_order(first, last):
                step.forward()
            self.record.note(first, last)

    def forget_last_pass(self) -> None:
        """Called before the inputs of a full pass are written. Does nothing in this engine."""

    def in_order(self, first: int, last: int | None) -> Iterator[Step]:
        """The steps that run the layers from ``first`` up to but not including ``last`` forwards."""
        return iter(self.steps[first:last])

    def backward(self, first: int = 0, last: int | None = None, on_done: BackwardHook | None = None) -> None:
        """Run the layers from ``first`` up to but not including ``last`` backwards; adds to parameter diffs."""
        with self.one_thread, np.errstate(all="ignore"):
            if not self.record.is_complete(first, last):
                if self.record.is_outdated(first, last):
                    self.reshape()
                self.record.clear_missing(self.steps, first, last)
            for step in reversed(self.steps[first:last]):
                step.backward(on_done)
                if on_done is not None:
                    on_done(step.at.layer)

    def reshape(self) -> bool:
        """Reshape all blobs after an input was reshaped. Returns whether any shape changed."""
        self._fits = False
        with self.one_thread:
            before, complete = self._all_shapes(), False
            try:
                for at in self.connections:
                    guarded(at.layer, "reshape", at.bottom, at.top)
                complete = True
            finally:
                self.record.note_reshape(complete)
            return before != self._all_shapes()

    def _all_shapes(self) -> list[tuple[int, ...]]:
        return [blob.shape for at in self.connections for blob in [*at.bottom, *at.top]]

    def hidden(self) -> list[Blob]:
        """Blobs that are not stored for the whole batch; none in this engine."""
        return []


class Engine:
    """The interface of an engine, and its plain implementation."""

    name = "plain"

    def implementation(self, cls: type[T]) -> type[T]:
        """The class that this engine uses in place of ``cls``, with the same results."""
        return cls

    def blob(self, dtype: DTypeLike) -> Blob:
        """Create a blob of a net."""
        return Blob((), dtype)

    def executor(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> Executor:
        """Create the executor of a net."""
        return Executor(connections, outside, name)

    def run(self, jobs: Sequence[Callable[[], None]]) -> None:
        """Run independent jobs and return when all are done."""
        for job in jobs:
            job()

    def copy(self, source: Array, target: Array) -> None:
        """Copy the values of one array into another."""
        target[...] = source

    def threads(self) -> int:
        """Number of threads in use."""
        return 1

    def set_threads(self, count: int) -> None:
        """Set the number of threads. Has no effect in this engine."""
        if count < 1:
            raise ValueError(f"the number of threads must be at least 1, got {count}")
