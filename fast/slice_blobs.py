"""Blobs of one slice of the batch (slices.py): a view of a whole blob, a hidden blob, a parameter of a lane."""

from __future__ import annotations

import threading
from typing import Any

from fast import aligned
from fast.parallel import buffer_of
from fast.tiles import FastBlob
from netlib.blob import Array, Blob


class Window(Blob):
    """A view of some items of a whole blob."""

    def __init__(self, whole: Blob, rows: slice, shape: tuple[int, ...]) -> None:
        super().__init__(shape, whole.dtype)
        self._whole, self._rows = whole, rows

    @property
    def data(self) -> Array:
        """The values of these items."""
        return self._whole.data[self._rows]

    @property
    def diff(self) -> Array:
        """The gradients of these items."""
        return self._whole.diff[self._rows]


class Hidden(FastBlob):
    """A blob of one slice. Its diff, and its data unless kept, are valid only until the thread's next slice."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, buffers: threading.local, key: int, keep: bool) -> None:
        super().__init__(shape, dtype)
        self._buffers, self._key, self._keep = buffers, key, keep

    @property
    def data(self) -> Array:
        """The values: memory of the slice if backward reads them again, else working memory of the thread."""
        if self._keep:
            if self._data is None:
                self._data = aligned.zeros(self.storage_shape, self.dtype)
            return self._data
        return self._buffer("data")

    @property
    def diff(self) -> Array:
        """The gradient, in working memory of the thread."""
        return self._buffer("diff")

    def _buffer(self, half: str) -> Array:
        return buffer_of(self._buffers, f"{half}{self._key}", self.storage_shape, self.dtype)


class ParamOfLane(Blob):
    """A parameter of one lane, which shares the values of the original and has its own diff."""

    def __init__(self, original: Blob) -> None:
        super().__init__(original.shape, original.dtype)
        self._original = original

    @property
    def data(self) -> Array:
        """The values of the original parameter."""
        return self._original.data
