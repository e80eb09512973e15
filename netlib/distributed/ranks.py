"""Ranks: several processes that train one net together, each on its own rows ("data parallel").

Every rank has the whole net and runs the prototxt's batch, so N ranks make a batch N times as large: row k of the data
goes to rank k mod N, gradients are the mean over the ranks, and every rank makes the same update. Rank 0 alone tests,
logs and writes snapshots.

``Ranks`` is a training alone, rank 0 of 1, and says what a solver asks of any; ``mpi.MPIRanks`` are several.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from netlib.blob import Array
from netlib.distributed.gradients import Gradients
from netlib.distributed.share import Share
from netlib.engine.plain import Passed
from netlib.errors import NetlibError


class Ranks:
    """A training alone."""

    rank, count, divide = 0, 1, False
    beside = 1  # ranks on this machine

    @property
    def share(self) -> Share:
        """What this rank reads."""
        return Share(self.rank, self.count, self.divide)

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """Raise NetlibError, on every rank, unless all ranks have the same facts about their training."""

    def of_root(self, number: int) -> int:
        """Rank 0's number."""
        return number

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """What fails within it on one rank fails on all."""
        try:
            yield
        except NetlibError as error:
            agreed = self.fail(error)
            if agreed is error:
                raise
            raise agreed from error

    def agree(self, loss: float, asked: str | None, checksum: int | None) -> float:
        """A step has been computed; the mean loss of all ranks.

        asked     a request to this solver, "stop" or "snapshot", or none
        checksum  of the parameters, now and then

        Raises what a rank has failed with, on every rank; NetlibError if checksums differ.
        """
        return loss

    def fail(self, error: Exception) -> Exception:
        """This rank cannot go on, and the others hear of it wherever they wait. Returns what to raise."""
        return error

    def asked(self, own: str | None) -> str | None:
        """What the ranks were asked for before the last ``agree``: any of them to stop, or rank 0 for a snapshot."""
        return own

    def from_root(self, own: str | None) -> str | None:
        """What rank 0 was asked for until now; the others wait for it."""
        return own

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays by their means over the ranks."""

    def begin_steps(self, gradients: Gradients) -> None:
        """Steps follow, whose gradients these are. Raises OutOfMemoryError."""

    def begin_gradients(self) -> Passed | None:
        """A backward pass that completes the gradients begins; returns what to call in it, if anything."""
        return None

    def finish_gradients(self) -> None:
        """All are complete; they are means over the ranks afterwards."""

    def gather(self, value: Mapping[str, Any]) -> list[dict[str, Any]]:
        """The values of the other ranks, in order, at rank 0; plain numbers, strings, lists. Elsewhere nothing."""
        return []

    def alive(self, seconds: float = 0.0) -> None:
        """Rank 0 is busy with what the others do not do; they may go on waiting, for so long if that is longer."""


ALONE = Ranks()
latest = [ALONE]  # of the solver that was made last, for layers that ask (caffe.solver_rank)
