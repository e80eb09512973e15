"""The fast executor: rows of layers in slices (slices.py), others whole, and blobs that are true whoever looks.

A blob inside a slice is *hidden*: it does not exist for the whole batch. When somebody first looks at its ``data`` or
``diff``, it is stored from then on, and what the last pass put there is computed again. That is true as long as the
inputs of that pass have not been overwritten and, for a diff, until the next forward. Who looks at two hidden blobs is
going to look at all: then none is hidden any more, and looking through all blobs of a net costs two passes at most.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import cast

import numpy as np

from fast.plan import Run, plan, whole
from fast.slices import SlicedStep
from fast.tiles import FastBlob, LazilyCleared
from fast.twin import Twin
from netlib.blob import Array, Blob
from netlib.errors import NetlibError
from netlib.one_thread import OneThread
from netlib.plain import Connection, Executor, Passed, Step, guarded


class SlicedExecutor(Executor):
    """Runs a net in slices where that pays, and layer by layer as soon as somebody asks for a part of it."""

    steps: Sequence[WholeStep | SlicedStep]

    def __init__(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> None:
        self.connections = list(connections)
        self.one_thread, self._fits = OneThread(name), False
        for at in self.connections:
            if isinstance(at.layer, Twin):
                at.layer.needs_backward, at.layer.needs_bottom_diff = at.needs_backward, any(at.propagate_down)
        self._stored = {id(blob) for blob in outside}
        self._looked = False
        self._by_layer = False
        self._seen = [False, False]  # has forward, has backward run
        self._plan()

    def _plan(self) -> None:
        """Decide what runs in slices, and watch the blobs that are hidden by it."""
        for at in self.connections:
            for blob in at.top:
                if isinstance(blob, FastBlob):
                    blob.on_look = None
        runs = [whole(at) for at in self.connections]
        if not self._by_layer:
            runs = plan(self.connections, lambda blob: id(blob) in self._stored)
        self.steps = [_step_of(run) for run in runs]
        for blob in self.hidden():
            assert isinstance(blob, FastBlob)
            blob.on_look = partial(_look, weakref.ref(self), blob)

    def hidden(self) -> list[Blob]:
        """Blobs that do not exist for the whole batch."""
        return [blob for step in self.steps if isinstance(step, SlicedStep) for blob in step.run.hidden]

    def forward(self, first: int = 0, last: int | None = None) -> None:
        """Run layers ``first`` to before ``last`` forwards."""
        with self.one_thread:
            if self._is_part(first, last):
                self._run_by_layer()
            super().forward(first, last)
            if not self._is_part(first, last):
                self._seen = [True, False]

    def in_order(self, first: int, last: int | None) -> Iterator[WholeStep | SlicedStep]:
        """What runs the layers. Where the layers before have left blobs of unequal numbers of items, a step that would
        cut them all alike is first divided into steps that can."""
        number, end = first, len(self.steps) if last is None else last
        while number < end:
            step = self.steps[number]
            if isinstance(step, SlicedStep) and not step.is_even():
                parts = self._divided(step)
                self.steps = [*self.steps[:number], *parts, *self.steps[number + 1 :]]
                end += len(parts) - 1
                continue
            yield step
            number += 1

    def _divided(self, step: SlicedStep) -> list[WholeStep | SlicedStep]:
        """Steps for the same layers, by the shapes that their blobs have now."""
        hidden = {id(blob): blob for blob in step.run.hidden}
        runs = plan(step.run.connections, lambda blob: id(blob) not in hidden)
        for key in hidden.keys() - {id(blob) for run in runs for blob in run.hidden}:
            cast(FastBlob, hidden[key]).on_look = None
        return [_step_of(run) for run in runs]

    def backward(self, first: int = 0, last: int | None = None, passed: Passed | None = None) -> None:
        """Run layers ``first`` to before ``last`` backwards."""
        with self.one_thread:
            if self._is_part(first, last):
                self._run_by_layer()
            super().backward(first, last, passed)
            if not self._is_part(first, last):
                self._seen[1] = True

    def reshape(self) -> None:
        """Shape all blobs anew; where no shape has changed, all stays as it is."""
        with self.one_thread:
            before = [blob.shape for at in self.connections for blob in [*at.bottom, *at.top]]
            super().reshape()
            if before != [blob.shape for at in self.connections for blob in [*at.bottom, *at.top]]:
                self._seen = [False, False]
                self._plan()

    def clear_diffs(self, params: Iterable[Blob]) -> None:
        """Set gradients of parameters to zero, or see to it that they read as zeros."""
        for param in params:
            if isinstance(param, LazilyCleared):
                param.clear()
            else:
                param.diff.fill(0)

    @staticmethod
    def _is_part(first: int, last: int | None) -> bool:
        return (first, last) != (0, None)

    def _run_by_layer(self) -> None:
        """A net that is run in parts runs layer by layer from then on: indices of steps are those of layers."""
        if not self._by_layer:
            self._by_layer = True
            self._replan()

    # ------------------------------------------------------------------------------------------ looking

    def reveal(self, blob: Blob) -> None:
        """Somebody looks at a hidden blob: store it from now on, with what the last pass put there."""
        with self.one_thread:
            self._stored |= {id(b) for b in self.hidden()} if self._looked else {id(blob)}
            self._looked = True
            self._replan()

    def _replan(self) -> None:
        """Plan anew, and let the new steps know what the old ones knew: values, winners, masks."""
        old = [step for step in self.steps if isinstance(step, SlicedStep)]
        self._plan()
        with np.errstate(all="ignore"):  # as in the pass whose values are computed again
            for step in old:
                self._repeat(step)

    def _repeat(self, old: SlicedStep) -> None:
        """Compute again what ``old`` computed in the last pass; whatever others can see stays as it is."""
        inside = {id(at) for at in old.run.connections}
        steps = [step for step in self.steps if id(step.at) in inside]
        params = [p for at in old.run.connections for p in at.layer.blobs]
        now = [(p.data, p.data.copy()) for p in params]
        _put_back(old.weights)
        if self._seen[0]:
            kept = [(b.data, b.data.copy()) for b in old.run.outside("top")]
            for step in steps:
                step.forward()
            _put_back(kept)
        if self._seen[1]:
            _put_back(old.weights_back)
            kept = [(b.diff, b.diff.copy()) for b in [*old.run.outside("bottom"), *params]]
            for step in reversed(steps):
                step.backward()
            _put_back(kept)
        _put_back(now)


def _step_of(run: Run) -> WholeStep | SlicedStep:
    return SlicedStep(run) if run.sliced else WholeStep(run.connections[0])


def _look(executor: weakref.ref[SlicedExecutor], blob: Blob) -> None:
    """Tell the executor that somebody looks at a hidden blob."""
    owner = executor()
    if owner is None:
        raise NetlibError("this blob was computed in slices and its net is gone; look at it, or copy it, before")
    owner.reveal(blob)


def _put_back(kept: list[tuple[Array, Array]]) -> None:
    for array, values in kept:
        array[...] = values


class WholeStep(Step):
    """One layer, run on the whole batch. Our own layers need a reshape only where a shape has changed."""

    def __init__(self, at: Connection) -> None:
        super().__init__(at)
        self._steady = at.layer.type != "Python"  # a Python layer may do what it likes
        self._blobs = [*at.bottom, *at.top]
        self._shapes: list[tuple[int, ...]] | None = None

    def forward(self) -> None:
        """Shape the tops and compute them."""
        if self._shapes != self._now() or not self._steady:
            guarded(self.at.layer, "reshape", self.at.bottom, self.at.top)
            self._shapes = self._now()
        guarded(self.at.layer, "forward", self.at.bottom, self.at.top)

    def _now(self) -> list[tuple[int, ...]]:
        """The shapes of all its blobs, which a caller may have changed."""
        return [blob.shape for blob in self._blobs]
