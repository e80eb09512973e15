"""Which rows of a training's data a net reads, where several processes train together (ranks.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netlib.graph import LayerHook
from netlib.layer import Layer


@dataclass(frozen=True)
class Share:
    """Which rows of a training's data a net reads.

    rank, count  those of row k with k mod count = rank
    divide       the prototxt's batch is that of all ranks together, not of each
    """

    rank: int = 0
    count: int = 1
    divide: bool = False

    def batch(self, size: int) -> int:
        """How many rows a rank reads of a prototxt's batch. Raises ValueError if they cannot be divided."""
        if not self.divide:
            return size
        if size % self.count:
            raise ValueError(f"a batch of {size} cannot be divided among {self.count} ranks; expected a multiple")
        return size // self.count

    def places(self, size: int) -> Iterator[int | None]:
        """Of every row of a step: its place in this rank's batch of ``size``; None if it is another rank's."""
        return (k // self.count if k % self.count == self.rank else None for k in range(size * self.count))

    def rows(self, done: int, take: int) -> tuple[slice, slice]:
        """Of ``take`` rows in a row, which follow ``done`` rows of a step: those of this rank, and their places in its
        batch."""
        first = (self.rank - done) % self.count
        place = (done + first) // self.count
        return slice(first, take, self.count), slice(place, place + len(range(first, take, self.count)))


EVERY_ROW = Share()


class RankOfLayers(LayerHook):
    """Makes the layers of a net those of one rank: which rows they read, and which random numbers they draw.

    Parameters and the order of the data are those of rank 0; what else is random is not.
    """

    def __init__(self, share: Share) -> None:
        self.share = share

    def before_setup(self, layer: Layer) -> None:
        """Tell a layer that reads data which rows are its own."""
        if hasattr(layer, "share"):
            layer.share = self.share

    def after_setup(self, layer: Layer, seed: np.random.SeedSequence) -> None:
        """Give the layers of other ranks than 0 random numbers of their own."""
        if self.share.rank:
            layer.rng.bit_generator.state = np.random.SFC64(seed.spawn(self.share.rank)[-1]).state
