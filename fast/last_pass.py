"""The last pass of a net that ran in slices, and its repetition, which computes the values of hidden blobs.

A repetition uses the weights, the inputs and the shapes of the pass, and changes no value that a caller can access.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from fast.slices import SlicedStep
from netlib.blob import Array, Blob
from netlib.engine.plain import Step

Halves = tuple["Array | None", "Array | None"]  # data and diff; None if not allocated


class LastPass:
    """A forward pass, and the backward pass after it, if ``has_backward``.

    steps      the steps of the pass, or those that have replaced them
    kept       inputs of sliced steps that a caller has accessed since: copies of their data in forward
    kept_back  blobs that a caller has accessed since backward: copies of their data and diff there
    """

    def __init__(self, steps: Sequence[Step]) -> None:
        self.steps = steps
        self.kept: dict[Blob, Array] = {}
        self.kept_back: dict[Blob, Halves] = {}
        self.has_backward = False
        runs = [step.run for step in self.sliced()]
        self._shapes = {blob: blob.shape for run in runs for at in run.connections for blob in [*at.bottom, *at.top]}
        self._inputs = {blob: blob.data for run in runs for blob in run.outside("bottom")}  # outlive a reshape
        self._reshaped: set[Blob] = set()

    def sliced(self) -> list[SlicedStep]:
        """The steps that ran in slices."""
        return [step for step in self.steps if isinstance(step, SlicedStep)]

    def keep(self, blob: Blob, with_diff: bool) -> None:
        """Copy a blob that a caller is about to access."""
        data, diff = (
            None if array is None else array.copy() for array in (blob._data, blob._diff if with_diff else None)
        )
        if data is not None:
            self.kept.setdefault(blob, data)
        if self.has_backward:
            self.kept_back[blob] = data, diff

    def is_rewritten(self) -> bool:
        """Whether a caller has modified an input of forward."""
        return any(not np.array_equal(data, blob.data) for blob, data in self.kept.items())

    def outlives_reshape(self) -> bool:
        """Record that the net was reshaped. Returns whether any blob still has values that ran in slices."""
        changed = self._changed()
        if changed:
            self._reshaped, self.has_backward = changed, False
            self.kept_back.clear()
        return any(top not in changed for step in self.sliced() for at in step.run.connections for top in at.top)

    def _changed(self) -> set[Blob]:
        return self._reshaped | {blob for blob, shape in self._shapes.items() if blob.shape != shape}

    @contextmanager
    def shapes(self) -> Iterator[bool]:
        """Temporarily set the shapes that the blobs had in the pass; yields whether others have replaced them."""
        changed = self._changed()
        with ExitStack() as stack:
            for blob in changed:
                stack.enter_context(_holding(blob, self._input(blob), shape=self._shapes[blob]))
            yield bool(changed)

    def _input(self, blob: Blob) -> Array | None:
        data = self.kept.get(blob, self._inputs.get(blob))
        return None if data is None else data.reshape(self._shapes[blob])

    def repeat(self, old: SlicedStep, steps: Sequence[Step]) -> None:
        """Repeat the layers of ``old``, a step of the pass, in the new ``steps``."""
        read, written = old.run.outside("bottom"), old.run.outside("top")
        with ExitStack() as stack:
            _hold(stack, old.weights)
            for blob in read:
                stack.enter_context(_holding(blob, self._input(blob)))
            for blob in written:
                stack.enter_context(_holding(blob, data=blob.data.copy()))
            for step in steps:
                step.forward()
        if self.has_backward:
            with ExitStack() as stack:
                _hold(stack, old.weights_back)
                for blob in [*read, *written]:
                    stack.enter_context(_holding(blob, *self.kept_back.get(blob, (None, None))))
                for blob in [*read, *(param for param, _ in old.weights_back)]:
                    stack.enter_context(_holding(blob, diff=blob.diff.copy()))
                for step in reversed(steps):
                    step.backward()


def _hold(stack: ExitStack, weights: Iterable[tuple[Blob, Array]]) -> None:
    for param, values in weights:
        stack.enter_context(_holding(param, data=values))


@contextmanager
def _holding(
    blob: Blob, data: Array | None = None, diff: Array | None = None, shape: tuple[int, ...] | None = None
) -> Iterator[None]:
    """Temporarily replace data and diff of a blob; with a shape, one that is not given is new. Blobs that share its
    memory are not affected.
    """
    before = blob._shape, blob._owner, blob._data, blob._diff_owner, blob._diff
    if shape is not None:
        blob._shape, blob._owner, blob._data, blob._diff_owner, blob._diff = shape, None, None, None, None
    if data is not None:
        blob._owner, blob._data = None, data
    if diff is not None:
        blob._diff_owner, blob._diff = None, diff
    try:
        yield
    finally:
        blob._shape, blob._owner, blob._data, blob._diff_owner, blob._diff = before
