"""Base class of layers that read rows of files: sharding, and the identity of the data."""

from __future__ import annotations

from typing import Any

from netlib.distributed.share import EVERY_ROW, Share
from netlib.layer import Layer


class Reader(Layer):
    """Base class of layers that read rows of files.

    share  the shard that this process reads in distributed training
    """

    share: Share = EVERY_ROW

    def batch_of(self, size: int) -> int:
        """Number of rows to read for a ``batch_size``: this rank's part if ranks divide it. Raises LayerError."""
        try:
            return self.share.batch(size)
        except ValueError as error:
            raise self.fail(str(error), "batch_size") from None

    def reads(self) -> Any:
        """Identity of the data, as JSON values."""
        raise NotImplementedError
