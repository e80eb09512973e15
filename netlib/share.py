"""Which rows of a training's data a net reads, where several processes train together (ranks.py)."""

from __future__ import annotations

from dataclasses import dataclass


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

    def rows(self, done: int, take: int) -> tuple[slice, slice]:
        """Of ``take`` rows in a row, which follow ``done`` rows of a step: those of this rank, and their places in its
        batch."""
        first = (self.rank - done) % self.count
        place = (done + first) // self.count
        return slice(first, take, self.count), slice(place, place + len(range(first, take, self.count)))


EVERY_ROW = Share()
