"""What all fast layers have: working memory, and what is asked of them backwards."""

from __future__ import annotations

import threading
from typing import Any

from numpy.typing import DTypeLike

from fast.parallel import buffer_of
from netlib.blob import Array
from netlib.layer import Layer


class FastLayer(Layer):
    """A layer that computes what its plain class computes, faster.

    needs_backward     will backward be called at all; set by the executor before the first pass
    needs_bottom_diff  will the diff of any bottom be needed
    """

    needs_backward: bool = True
    needs_bottom_diff: bool = True

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._buffers = threading.local()

    def buffer(self, key: str, shape: tuple[int, ...], dtype: DTypeLike | None = None) -> Array:
        """Working memory of the calling thread: zeros at first, then whatever was left in it."""
        return buffer_of(self._buffers, key, shape, dtype or self.dtype)

    # For layers that can handle tiles (tiles.py)

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The tile in which this layer would like its bottoms if its top has ``top_tile``; None: plain."""
        return None

    def writes_tiles(self) -> bool:
        """Can the tops be tiled, whatever the tile?"""
        return False

    def writes_sparse(self) -> bool:
        """Can a tiled top be sparse?"""
        return False

    def reads_sparse(self) -> bool:
        """Can a tiled bottom be sparse?"""
        return False
