"""FastHDF5Data: a thread reads the next batch while the net computes.

Two batches are in memory: the one in the tops and the one being read. Each forward swaps them, so an array obtained
from a top is valid until the next forward.
"""

from __future__ import annotations

import os
from concurrent.futures import Future
from typing import Any

import numpy as np

from fast.fast_layer import FastLayer
from fast.parallel import Workers
from layers.data.hdf5_data import Cursor, HDF5Data
from netlib.blob import Array, Blobs


class FastHDF5Data(FastLayer, HDF5Data):
    """HDF5Data that reads one batch ahead."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Set up the layer and start the thread that reads."""
        super().setup(bottom, top)
        self._reader = Workers(1, "hdf5_data")
        self._ahead: Future[Cursor] | None = None
        self._next: list[Array] = []

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and allocate the next batch."""
        super().reshape(bottom, top)
        if [array.shape for array in self._next] != [blob.shape for blob in top]:
            self._drop_ahead()
            self._next = [np.empty(blob.shape, self.dtype) for blob in top]

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Move the batch read ahead to the tops, and start reading the next one."""
        if self._reader.process != os.getpid():
            self._ahead = None  # a thread of the process that forked this one reads it
        ahead = self._ahead or self._reader.submit(self.read, self.cursor, self._next)
        self._ahead = None  # if it failed, the next forward tries again
        self.cursor = ahead.result()
        for i, blob in enumerate(top):
            self._next[i], blob._data = blob.data, self._next[i]
        self._ahead = self._reader.submit(self.read, self.cursor, self._next)

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a position in the data, and discard the batch read ahead."""
        self._drop_ahead()
        super().restore(state)

    def rewind(self) -> None:
        """Continue with the first row, and discard the batch read ahead."""
        self._drop_ahead()
        super().rewind()

    def use_batch_size(self, size: int) -> None:
        """Read ``size`` rows at a time from now on, and discard the batch read ahead."""
        self._drop_ahead()
        super().use_batch_size(size)

    def _drop_ahead(self) -> None:
        if self._ahead is not None:
            self._ahead.exception()  # waits; the result and any exception are discarded
            self._ahead = None
