"""Sharding: which rows of the data each process of a distributed training reads (ranks.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netlib.graph import LayerHook
from netlib.layer import Layer


@dataclass(frozen=True)
class Shard:
    """The shard of the data that one rank reads.

    rank, count  the rank reads rows k with k mod count = rank
    divide       split the prototxt's batch among the ranks instead of using it on each
    """

    rank: int = 0
    count: int = 1
    divide: bool = False

    def batch(self, size: int) -> int:
        """Number of rows that a rank reads of a prototxt's batch. Raises ValueError if it cannot be divided."""
        if not self.divide:
            return size
        if size % self.count:
            raise ValueError(
                f"a batch of {size} cannot be divided among {self.count} ranks; expected a multiple of {self.count}"
            )
        return size // self.count

    def places(self, size: int) -> Iterator[int | None]:
        """For every row of a step, its index in this rank's batch of ``size``, or None if another rank reads it."""
        return (k // self.count if k % self.count == self.rank else None for k in range(size * self.count))

    def rows(self, done: int, take: int) -> tuple[slice, slice]:
        """Of ``take`` consecutive rows that follow ``done`` rows of a step: the rows of this rank, and their indices
        in its batch."""
        first = (self.rank - done) % self.count
        place = (done + first) // self.count
        return slice(first, take, self.count), slice(place, place + len(range(first, take, self.count)))


EVERY_ROW = Shard()


class RankOfLayers(LayerHook):
    """Sets up the layers of a net for one rank: the rows that they read and their random numbers.

    Parameters and the order of the data are the same on all ranks; other random numbers differ.
    """

    def __init__(self, shard: Shard) -> None:
        self.shard = shard

    def before_setup(self, layer: Layer) -> None:
        """Set the shard of layers that read data."""
        if hasattr(layer, "shard"):
            layer.shard = self.shard

    def after_setup(self, layer: Layer, seed: np.random.SeedSequence) -> None:
        """Give layers their own random numbers on ranks other than 0."""
        if self.shard.rank:
            layer.rng.bit_generator.state = np.random.SFC64(seed.spawn(self.shard.rank)[-1]).state
