"""FastHDF5Data: reads a batch ahead, by a thread, while the net computes.

Two batches are in memory, the one in the tops and the one that is being read. They change places, so an array taken
from a top is good until the next forward.
"""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import numpy as np

from fast.fast_layer import FastLayer
from fast.parallel import Workers
from fast.tiles import FastBlob
from layers.data.hdf5_data import Cursor, HDF5Data
from netlib.blob import Array, Blobs
from netlib.system.one_thread import call_after_fork


class FastHDF5Data(FastLayer, HDF5Data):
    """Batches, one ahead."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Start the reader."""
        super().setup(bottom, top)
        self._reader = Workers(1, "hdf5_data")
        self._ahead: Future[Cursor] | None = None
        self._next: list[Array] = []
        call_after_fork(self)

    def after_fork(self) -> None:
        """The batch that was being read ahead stays unread; the next forward reads it again."""
        self._ahead = None

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Have room for the next batch."""
        super().reshape(bottom, top)
        if [array.shape for array in self._next] != [blob.shape for blob in top]:
            self._drop_ahead()
            self._next = [np.empty(blob.shape, self.dtype) for blob in top]

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Take what was read ahead, and have the next batch read."""
        ahead = self._ahead or self._reader.submit(self.read, self.cursor, self._next)
        self._ahead = None  # if it failed, the next forward tries again
        self.cursor = ahead.result()
        for i, blob in enumerate(top):
            read, used = self._next[i], blob.data
            if isinstance(blob, FastBlob):
                blob.adopt(read)
                self._next[i] = used
            else:  # a layer run alone
                used[...] = read
        self._ahead = self._reader.submit(self.read, self.cursor, self._next)

    def restore(self, state: dict[str, Any]) -> None:
        """What was read ahead no longer comes next."""
        self._drop_ahead()
        super().restore(state)

    def rewind(self) -> None:
        """Also forgets what was read ahead."""
        self._drop_ahead()
        super().rewind()

    def use_batch_size(self, size: int) -> None:
        """Also forgets what was read ahead."""
        self._drop_ahead()
        super().use_batch_size(size)

    def _drop_ahead(self) -> None:
        if self._ahead is not None:
            self._ahead.exception()  # waits; the batch, or the reason why it could not be read, is not needed
            self._ahead = None
