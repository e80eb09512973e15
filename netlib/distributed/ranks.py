"""Ranks: several processes that train one net together, each on its own rows ("data parallel").

Every rank holds the whole net and runs the prototxt's batch, so N ranks make the batch N times as large: row k of the
data goes to rank k mod N, gradients are averaged over the ranks, and every rank makes the same update. Rank 0 alone
tests, logs and writes snapshots.

``Ranks`` defines the interface and is a single process, rank 0 of 1; ``mpi.MPIRanks`` implements several.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from netlib.blob import Array
from netlib.distributed.allreduce import Gradients
from netlib.distributed.shard import Shard
from netlib.errors import NetlibError
from netlib.training.callbacks import Request


class Ranks:
    """A single process."""

    rank, count, divide = 0, 1, False
    on_machine = 1  # number of ranks on this machine

    @property
    def shard(self) -> Shard:
        """The shard of the data that this rank reads."""
        return Shard(self.rank, self.count, self.divide)

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """Raise NetlibError on every rank unless the facts about the training are equal on all ranks."""

    def of_root(self, number: int) -> int:
        """Return the number of rank 0."""
        return number

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Context manager: a NetlibError raised in it on one rank is raised on all."""
        try:
            yield
        except NetlibError as error:
            agreed = self.fail(error)
            if agreed is error:
                raise
            raise agreed from error

    def agree(self, loss: float, request: Request | None, checksum: int | None) -> float:
        """Agree after the gradients of a step are computed; returns the mean loss over the ranks.

        request   a request to this solver: "stop", "snapshot" or None
        checksum  of the parameters, or None if they are not compared in this step

        If a rank failed, raises its error on every rank. Raises NetlibError if checksums differ.
        """
        return loss

    def fail(self, error: Exception) -> Exception:
        """Report to the other ranks that this one failed. Returns the exception to raise."""
        return error

    def asked(self, own: Request | None) -> Request | None:
        """Request that counts after the last ``agree``: "stop" from any rank, or "snapshot" from rank 0."""
        return own

    def from_root(self, own: Request | None) -> Request | None:
        """Request to rank 0, which the others wait for."""
        return own

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays by their means over the ranks."""

    def begin_steps(self, gradients: Gradients) -> None:
        """Prepare for steps with these gradients. Raises OutOfMemoryError."""

    def finish_gradients(self) -> None:
        """Called when all gradients are complete; afterwards they are means over the ranks."""

    def gather(self, value: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return, at rank 0, the JSON values of the other ranks in order; elsewhere an empty list."""
        return []

    def alive(self, seconds: float = 0.0) -> None:
        """Called by rank 0 while it works alone; the others extend their timeout, to ``seconds`` if that is longer."""


ALONE = Ranks()
latest = ALONE  # of the last DataParallel of this process, for layers that read caffe.solver_rank
