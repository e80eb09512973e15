"""Base class of all fast layers: working memory, needed gradients, and support for tiles."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from numpy.typing import DTypeLike

from fast.parallel import aligned, buffer_of
from netlib.blob import Array
from netlib.layer import Layer


class FastLayer(Layer):
    """A layer that computes the same as its plain class, but faster.

    needs_backward     whether backward will be called; set by the engine before the first pass
    needs_bottom_diff  whether the diff of any bottom will be needed
    after              layers in place on the top that forward computes, too (fusing.py)
    is_fused           whether an earlier layer computes forward, which is then not called
    """

    needs_backward: bool = True
    needs_bottom_diff: bool = True
    after: Sequence[FastLayer] = ()
    is_fused: bool = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._buffers = threading.local()
        self._for_backward: dict[str, Array] = {}

    def buffer(self, key: str, shape: tuple[int, ...], dtype: DTypeLike | None = None) -> Array:
        """Working memory of the calling thread: initially zeros, later the values
        of its last use.
        """
        return buffer_of(self._buffers, key, shape, dtype or self.dtype)

    def for_backward(self, key: str, like: Array) -> Array:
        """Memory of this layer for values that backward reads, with the shape and
        type of ``like``.
        """
        found = self._for_backward.get(key)
        if found is None or found.shape != like.shape:
            found = self._for_backward[key] = aligned(like.shape, like.dtype)
        return found

    def forget(self) -> None:
        """Release the memory of ``for_backward``, which a copy of a layer must not share."""
        self._for_backward = {}

    def take_memory(self) -> None:
        """Copy what backward reads from the memory of the layer that has computed forward until
        now, and may be run without this one from now on.
        """

    # Layers that compute others behind them (fusing.py) override these methods.

    def fuses_relu(self) -> bool:
        """Whether forward can compute a ReLU behind the layer."""
        return False

    def fuses_channels(self) -> bool:
        """Whether forward can compute a multiplication and an addition per channel
        behind the layer.
        """
        return False

    def fuses_trained_scale(self) -> bool:
        """Whether forward and backward can compute a Scale behind the layer that has a
        backward pass.
        """
        return False

    # Layers that can change places (plan.py) override these methods.

    def is_monotone(self) -> bool:
        """Whether the layer is elementwise and non-decreasing, and f(f(x)) = f(x), so that it may
        be moved behind a max pooling.
        """
        return False

    def takes_maximum(self) -> bool:
        """Whether every top value is the maximum of some bottom values."""
        return False

    # Layers that support tiles (tiles.py) override these methods.

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The tile of the bottoms with which this layer is fastest if its top has ``top_tile``;
        None: not tiled.
        """
        return None

    def writes_tiles(self) -> bool:
        """Whether the tops can be tiled, with any tile."""
        return False

    def writes_sparse(self) -> bool:
        """Whether a tiled top can be sparse."""
        return False

    def reads_sparse(self) -> bool:
        """Whether a tiled bottom can be sparse."""
        return False


def is_fused(layer: Layer) -> bool:
    """Whether an earlier layer computes a layer's forward."""
    return isinstance(layer, FastLayer) and layer.is_fused
