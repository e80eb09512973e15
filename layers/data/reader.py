"""Base class of layers that read rows of files: sharding, and the identity of the data."""

from __future__ import annotations

from typing import Any

from netlib.distributed.ranks import EVERY_ROW, Shard
from netlib.layer import Layer


class Reader(Layer):
    """Base class of layers that read rows of files.

    shard  the shard that this process reads in distributed training
    """

    shard: Shard = EVERY_ROW

    def batch_of(self) -> int:
        """Number of rows to read for the ``batch_size``: this rank's part if ranks divide it.

        Raises LayerError.
        """
        if self.param.batch_size == 0:
            raise self.fail("batch_size must be at least 1", "batch_size")
        try:
            return self.shard.batch(self.param.batch_size)
        except ValueError as error:
            raise self.fail(str(error), "batch_size") from None

    def reads(self) -> Any:
        """Identity of the data, as JSON values."""
        raise NotImplementedError
