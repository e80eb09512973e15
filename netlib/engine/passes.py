"""Which layers have run forwards, and what a backward pass does with those that have not.

As in Caffe, backward may be called at any time: after the net is built, after a part of a forward pass, or after a
reshape. A layer that has not run forwards with the current shapes reads the current data of its blobs, and zeros in
place of what its forward would have stored (``Layer.clear``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from netlib.blob import Blob


class Clearable(Protocol):
    """A step of an executor."""

    def clear(self) -> None:
        """Prepare ``backward`` without ``forward``."""


class ForwardRecord:
    """Records which layers of a net have run forwards with the current shapes.

    ``count`` is the number of layers; ``outside`` are the blobs whose shapes a caller can change.
    """

    def __init__(self, count: int, outside: Sequence[Blob]) -> None:
        self._has_run, self._outside = [False] * count, outside
        self._shapes = self._now()

    def note(self, first: int, last: int | None) -> None:
        """Record that the layers from ``first`` up to but not including ``last`` have run."""
        if self.is_outdated():
            self.forget()
        self._has_run[first:last] = [True] * len(self._has_run[first:last])

    def forget(self) -> None:
        """Record that no layer has run with the current shapes."""
        self._has_run = [False] * len(self._has_run)
        self._shapes = self._now()

    def is_outdated(self) -> bool:
        """Whether a caller has changed a shape without a reshape of the net."""
        return self._shapes != self._now()

    def is_complete(self, first: int, last: int | None) -> bool:
        """Whether all these layers have run with the current shapes."""
        return all(self._has_run[first:last]) and not self.is_outdated()

    def clear_missing(self, steps: Sequence[Clearable], first: int, last: int | None) -> None:
        """Clear those of the steps, one per layer, that have not run."""
        for step, has_run in zip(steps[first:last], self._has_run[first:last]):
            if not has_run:
                step.clear()

    def _now(self) -> list[tuple[int, ...]]:
        return [blob.shape for blob in self._outside]
