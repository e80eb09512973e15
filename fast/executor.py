"""The fast executor: runs sequences of layers in slices (slices.py), and other layers on the whole batch.

A blob inside a slice is *hidden*: it is not stored for the whole batch. At the first access to its ``data`` or
``diff``, its values of the last pass are computed again, and it is stored in all later passes. The computation uses the
weights and the inputs of the last pass. An input is copied when the caller first accesses it after the pass, because
the caller may then modify it. An array that the caller obtained before the pass is not copied: modifying it changes the
values that are computed again. A hidden diff can be computed again until the next forward pass or reshape. After a
reshape, hidden data whose shape did not change is computed again in the shapes of the last pass.

After the access to a second hidden blob no blob is hidden any more, so a loop over all blobs costs at most two passes.

Blobs of Split, Concat and Slice layers outside of slices share memory (shared_memory.py), each until a caller accesses
it, and all until a part of the net is run.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from fast.fast_layer import FastLayer, plain_copy
from fast.fusing import fuse, release
from fast.last_pass import LastPass
from fast.plan import Run, plan, whole
from fast.shared_memory import separate, share
from fast.slices import SlicedStep
from netlib.blob import Blob
from netlib.engine.checks import guarded, run_backward
from netlib.engine.plain import BackwardHook, Connection, Executor, Step
from netlib.errors import NetlibError
from netlib.layer import Layer


class SlicedExecutor(Executor):
    """Runs a net in slices where that is faster, and layer by layer after a partial pass."""

    steps: Sequence[WholeStep | SlicedStep]

    def __init__(self, connections: Sequence[Connection], outside: Iterable[Blob], name: str = "") -> None:
        super().__init__(connections, outside, name)
        for at in self.connections:
            if isinstance(at.layer, FastLayer):
                at.layer.needs_backward, at.layer.needs_bottom_diff = at.needs_backward, any(at.propagate_down)
        self._stored = set(self._outside)
        self._looked = False
        self._by_layer = False
        self._last: LastPass | None = None
        self._watched: list[Blob] = []
        self._sharing: set[Blob] = set()
        self._may_share = True  # whether blobs have shapes for which sharing was not decided yet
        self._planned_for: list[tuple[bool, bool, tuple[int, ...]]] = []
        self._plan()

    def _plan(self, old: Sequence[Step] = ()) -> None:
        """Select the layers that run in slices, and register callbacks for accesses to the hidden blobs.

        Layers of different steps of the last pass, ``old``, are not joined in one step, because a step can be repeated
        only if all its layers ran in slices: the inputs of other layers are not kept.
        """
        for at in self.connections:
            for blob in at.top:
                blob.on_look = None
        release(self.connections) if self._by_layer else fuse(self.connections)
        if self._by_layer:
            runs = [whole(at) for at in self.connections]
        elif old:
            runs = [run for step in old for run in self._refined(step)]
        else:
            runs = plan(self.connections, lambda blob: blob in self._stored)
        self.steps, self._planned_for = [_step_of(run) for run in runs], self._item_shapes()
        self._end_sharing()
        for blob in self.hidden():
            blob.on_look = partial(_look, weakref.ref(self), blob)

    def _item_shapes(self) -> list[tuple[bool, bool, tuple[int, ...]]]:
        """What determines a plan: for each blob, whether it has as many items as the first, or one, and its shape."""
        blobs = [blob for at in self.connections for blob in [*at.bottom, *at.top]]
        return [(blob.shape[:1] == blobs[0].shape[:1], blob.shape[:1] == (1,), blob.shape[1:]) for blob in blobs]

    def hidden(self) -> list[Blob]:
        """Blobs that are not stored for the whole batch."""
        return [blob for step in self.steps if isinstance(step, SlicedStep) for blob in step.run.hidden]

    def forward(self, first: int = 0, last: int | None = None) -> None:
        """Run the layers from ``first`` up to but not including ``last`` forwards."""
        with self.one_thread:
            if self._is_part(first, last):
                self._run_by_layer()
            self.forget_last_pass()
            super().forward(first, last)
            if not self._is_part(first, last):
                self._last = LastPass(self.steps)
                self._watch()

    def in_order(self, first: int, last: int | None) -> Iterator[WholeStep | SlicedStep]:
        """Yield the steps that run the layers. A sliced step is first divided into several if earlier layers have
        changed the number of items of some of its blobs, because one division into slices must fit all of them."""
        if self._may_share and not self._is_part(first, last):
            self._share()
        number, end = first, len(self.steps) if last is None else last
        while number < end:
            step = self.steps[number]
            if isinstance(step, SlicedStep) and not step.is_even():
                parts = self._divided(step)
                self.steps = [*self.steps[:number], *parts, *self.steps[number + 1 :]]
                self._planned_for = []
                end += len(parts) - 1
                continue
            yield step
            number += 1

    def _refined(self, step: Step) -> list[Run]:
        """Plan the layers of a step again from the current shapes; of its blobs, those now stored are not hidden."""
        if not isinstance(step, SlicedStep):
            return [whole(step.at)]
        hidden = set(step.run.hidden)
        return plan(step.run.connections, lambda blob: blob in self._stored or blob not in hidden)

    def _divided(self, step: SlicedStep) -> list[WholeStep | SlicedStep]:
        """Plan new steps for the same layers from the current shapes of their blobs."""
        runs = self._refined(step)
        still_hidden = {blob for run in runs for blob in run.hidden}
        for blob in step.run.hidden:
            if blob not in still_hidden:
                blob.on_look = None
        return [_step_of(run) for run in runs]

    def backward(self, first: int = 0, last: int | None = None, on_done: BackwardHook | None = None) -> None:
        """Run the layers from ``first`` up to but not including ``last`` backwards."""
        with self.one_thread:
            complete = self.record.is_complete(first, last)
            if self._is_part(first, last) or not complete or self._is_rewritten():
                self._run_by_layer()
            self._unwatch()
            super().backward(first, last, on_done)
            if self._last is not None:
                self._last.kept_back.clear()
                self._last.has_backward |= not self._is_part(first, last)
            self._watch()

    def reshape(self) -> bool:
        """Reshape all blobs after an input was reshaped. Returns whether any shape changed."""
        with self.one_thread:
            try:
                changed = super().reshape()
            finally:  # an error leaves some blobs with new shapes
                if self._last is not None and not self._last.outlives_reshape():
                    self.forget_last_pass()
            if changed:
                self._end_sharing()
                if self._item_shapes() != self._planned_for:
                    self._plan()
                self._watch()
        return changed

    @staticmethod
    def _is_part(first: int, last: int | None) -> bool:
        return (first, last) != (0, None)

    def _is_rewritten(self) -> bool:
        """Whether a caller has modified an input of forward. Slices may no longer have the values for backward."""
        return self._last is not None and self._last.is_rewritten()

    def _run_by_layer(self) -> None:
        """Switch permanently to one step per layer, so that a part of the net can be run by the indices of layers."""
        if not self._by_layer:
            self._by_layer = True
            self._replan()

    # ------------------------------------------------------------------------------------------ shared memory

    def _share(self) -> None:
        """Let blobs share memory that only layers on the whole batch read and write."""
        in_slices = [at for step in self.steps if isinstance(step, SlicedStep) for at in step.run.connections]
        of_users = [at for at in self.connections if at.layer.type == "Python"]  # may write their bottoms
        apart = {*self._outside, *(blob for at in [*in_slices, *of_users] for blob in [*at.bottom, *at.top])}
        self._sharing |= share(self.connections, lambda blob: blob not in apart)
        self._may_share = False

    def _end_sharing(self) -> None:
        """Give every blob separate memory; the next pass shares that of new blobs, unless it runs layer by layer."""
        for blob in self._sharing:
            separate(blob)
        self._sharing.clear()
        self._may_share = not self._by_layer

    # ------------------------------------------------------------------------------------------ hidden blobs

    def reveal(self, blob: Blob) -> None:
        """Compute the values of a hidden blob in the last pass, and store it in all later passes."""
        with self.one_thread:
            self._stored |= set(self.hidden()) if self._looked else {blob}
            self._looked = True
            self._replan()

    def _replan(self) -> None:
        """Plan again, and restore the state of the old steps in the new ones: values, winners, masks."""
        self._unwatch()
        if self._last is None:
            self._plan(self.steps)
            return
        with self._last.shapes() as are_replaced, np.errstate(all="ignore"):  # as in the pass that is repeated
            old = self._last.sliced()
            if are_replaced:  # a plan for other shapes would hide other blobs
                self._stored |= {blob for step in old for blob in step.run.hidden}
            self._plan(self._last.steps)
            self._last.steps = self.steps
            for step in old:
                inside = set(step.run.connections)
                self._last.repeat(step, [new for new in self.steps if new.at in inside])
        if are_replaced:
            if not self.record.is_outdated(0, None):
                super().reshape()
            self._plan()
        self._watch()

    # Inputs of the last pass are copied before a caller can modify them.

    def _watch(self) -> None:
        """Register callbacks that copy shared blobs and the inputs of sliced steps before a caller's first access."""
        for shared in self._sharing:
            shared.on_look_data = partial(_separate, weakref.ref(self), weakref.ref(shared))
        self._watched += self._sharing
        if self._last is None:
            return
        kept = self._last.kept_back if self._last.has_backward else self._last.kept
        for run in [step.run for step in self._last.sliced()]:
            for blob in run.outside("top") if self._last.has_backward else []:
                if blob.on_look is None and blob not in kept:
                    blob.on_look = partial(_keep, weakref.ref(self), blob)
                    self._watched.append(blob)
            for blob in run.outside("bottom"):  # backward does not read their diffs
                if blob.on_look is None and blob not in kept:
                    blob.on_look_data = partial(_keep, weakref.ref(self), blob)
                    self._watched.append(blob)

    def _unwatch(self) -> None:
        for blob in self._watched:
            blob.on_look = blob.on_look_data = None
        self._watched.clear()

    def keep(self, blob: Blob) -> None:
        """Copy a blob that a caller is about to access."""
        with_diff = blob.on_look is not None
        blob.on_look = blob.on_look_data = None
        if self._last is not None:
            self._last.keep(blob, with_diff)

    def forget_last_pass(self) -> None:
        """Discard what a repetition of the last pass needs."""
        self._unwatch()
        self._last = None


def _step_of(run: Run) -> WholeStep | SlicedStep:
    return SlicedStep(run) if run.sliced else WholeStep(run.connections[0])


def _look(executor: weakref.ref[SlicedExecutor], blob: Blob) -> None:
    """Callback of a hidden blob before its first access: store its values. Raises NetlibError if the net is gone."""
    owner = executor()
    if owner is None:
        raise NetlibError("this blob was computed in slices and its net is gone; look at it, or copy it, before")
    owner.reveal(blob)


def _separate(executor: weakref.ref[SlicedExecutor], blob: weakref.ref[Blob]) -> None:
    """Callback of a blob with shared memory before its first access after a pass."""
    shared, owner = blob(), executor()
    assert shared is not None
    shared.on_look_data = None
    separate(shared)
    if owner is not None:
        owner._sharing.discard(shared)


def _keep(executor: weakref.ref[SlicedExecutor], blob: Blob) -> None:
    """Callback of an input of a pass before its first access after the pass: copy it."""
    owner = executor()
    if owner is None:
        blob.on_look = blob.on_look_data = None
    else:
        owner.keep(blob)


class WholeStep(Step):
    """One layer, run on the whole batch. Layers of this project are reshaped only after a shape has changed."""

    def __init__(self, at: Connection) -> None:
        super().__init__(at)
        self._steady = at.layer.type != "Python"  # reshape of a Python layer may depend on more than shapes
        self._blobs = [*at.bottom, *at.top]
        self._shapes: list[tuple[int, ...]] | None = None
        self._plain: Layer | None = None  # computes backward if forward has not run

    def forward(self) -> None:
        """Reshape the tops if necessary and compute them."""
        if self._shapes != self._now() or not self._steady:
            guarded(self.at.layer, "reshape", self.at.bottom, self.at.top)
            self._shapes = self._now()
        guarded(self.at.layer, "forward", self.at.bottom, self.at.top)
        self._plain = None

    def clear(self) -> None:
        """Let the plain layer compute the next backward: only it defines its state before the first forward."""
        if self.at.needs_backward:
            self._plain = plain_copy(self.at.layer)
            guarded(self._plain, "reshape", self.at.bottom, self.at.top)
            guarded(self._plain, "clear", self.at.bottom, self.at.top)

    def backward(self, on_done: BackwardHook | None = None) -> None:
        """Compute the diffs, if needed."""
        if self.at.needs_backward:
            run_backward(self.at, self._plain)

    def _now(self) -> list[tuple[int, ...]]:
        """The current shapes of all bottoms and tops, which a caller may have changed."""
        return [blob.shape for blob in self._blobs]
