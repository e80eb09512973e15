"""Which layers have run forwards, and what a backward pass does with those that have not.

As in Caffe, backward may be called at any time: after the net is built, after a part of a forward pass, or after a
reshape. A layer that has not run forwards with the current shapes reads the current data of its blobs, and zeros in
place of what its forward would have stored (``Layer.clear``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from netlib.blob import Blobs


class Connected(Protocol):
    """A layer's bottom and top blobs."""

    bottom: Blobs
    top: Blobs


class Clearable(Protocol):
    """A step of an executor."""

    def clear(self) -> None:
        """Prepare ``backward`` without ``forward``."""


class ForwardRecord:
    """Records which layers of a net have run forwards with the current shapes of their blobs."""

    def __init__(self, connections: Sequence[Connected]) -> None:
        self._connections = connections
        self._has_run = [False] * len(connections)
        self._shapes = [_shapes_of(at) for at in connections]  # when the layer ran, or was reshaped

    def note(self, first: int, last: int | None) -> None:
        """Record that the layers from ``first`` up to but not including ``last`` have run."""
        self._has_run[first:last] = [True] * len(self._has_run[first:last])
        self._shapes[first:last] = [_shapes_of(at) for at in self._connections[first:last]]

    def note_reshape(self, complete: bool) -> None:
        """Record that the net was reshaped: layers with new shapes have not run. If not ``complete``, because a layer
        rejected its shapes, the new shapes are outdated."""
        now = [_shapes_of(at) for at in self._connections]
        self._has_run = [ran and old == new for ran, old, new in zip(self._has_run, self._shapes, now)]
        if complete:
            self._shapes = now

    def is_outdated(self, first: int, last: int | None) -> bool:
        """Whether a blob of these layers has another shape than when they ran or were reshaped."""
        return self._shapes[first:last] != [_shapes_of(at) for at in self._connections[first:last]]

    def is_complete(self, first: int, last: int | None) -> bool:
        """Whether all these layers have run with the current shapes."""
        return all(self._has_run[first:last]) and not self.is_outdated(first, last)

    def clear_missing(self, steps: Sequence[Clearable], first: int, last: int | None) -> None:
        """Clear those of the steps, one per layer, that have not run."""
        for step, has_run in zip(steps[first:last], self._has_run[first:last]):
            if not has_run:
                step.clear()


def _shapes_of(at: Connected) -> list[tuple[int, ...]]:
    return [blob.shape for blob in (*at.bottom, *at.top)]
