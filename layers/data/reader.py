"""Base class of layers that read rows of files: sharding, and the identity of the data."""

from __future__ import annotations

from typing import Any

from netlib.distributed.shard import EVERY_ROW, Shard
from netlib.layer import Layer


class Reader(Layer):
    """Base class of layers that read rows of files.

    shard  the shard that this process reads in distributed training
    """

    shard: Shard = EVERY_ROW

    def batch_of(self, size: int) -> int:
        """Number of rows to read for a ``batch_size``: this rank's part if ranks divide it. Raises LayerError."""
        try:
            return self.shard.batch(size)
        except ValueError as error:
            raise self.fail(str(error), "batch_size") from None

    def reads(self) -> Any:
        """Identity of the data, as JSON values."""
        raise NotImplementedError
