"""What layers that read rows of files share: which rows are theirs, and what tells their data from others."""

from __future__ import annotations

from typing import Any

from netlib.distributed.share import EVERY_ROW, Share
from netlib.layer import Layer


class Reader(Layer):
    """Base of layers that read rows of files.

    share  which rows of a step are read here, where several processes train together
    """

    share: Share = EVERY_ROW

    def batch_of(self, size: int) -> int:
        """How many rows to read of a ``batch_size``: its own, where several ranks divide it. Raises LayerError."""
        try:
            return self.share.batch(size)
        except ValueError as error:
            raise self.fail(str(error), "batch_size") from None

    def reads(self) -> Any:
        """What tells the data from others, as plain numbers, strings, lists."""
        raise NotImplementedError
