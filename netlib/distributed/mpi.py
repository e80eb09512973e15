"""Ranks over MPI (mpi4py): averaging gradients, agreement, and joint termination.

    mpiexec -n 4 python -m mpi4py tools/train.py SOLVER

**Means** of the gradients are computed in the order of the ranks (allreduce.py). On several machines this starts while
layers still run backwards.

**Agreement**: every rank then sends rank 0 five numbers (loss, request, failure flag, checksum, whether averages are in
progress), and rank 0 sends the table to all. A signal that reaches the ranks in different steps therefore stops all of
them after the same step, and an error of one rank is raised on all.

**Timeouts**: if a rank stops responding, the others end too. No call blocks: a waiting rank polls its requests, the
clock, heartbeats of rank 0 (``alive``), and roll calls, in which rank 0 finds out which rank does not respond.
"""

from __future__ import annotations

import faulthandler
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.distributed.allreduce import Averaging, Gradients, Means, Requests
from netlib.distributed.ranks import Ranks
from netlib.errors import DataError, DivergenceError, NetlibError, WeightsError, reason_of
from netlib.training.callbacks import Request

REQUESTS: tuple[Request | None, ...] = (None, "snapshot", "stop")
STOP = REQUESTS.index("stop")
ERRORS: dict[str, type[NetlibError]] = {
    cls.__name__: cls for cls in (NetlibError, DataError, DivergenceError, WeightsError)
}
LOSS, ASKED, FAILED, CHECKSUM, UNDER_WAY = range(5)  # columns of the table
NO_CHECKSUM = -1.0
TO_ROOT, TO_ALL, ALIVE, HERE = range(1, 5)  # message tags
ROLL_CALL = -1.0  # sent instead of a number of seconds
START_S = 120.0  # timeout before the first step
MIN_S, STEPS = 10.0, 20.0  # later timeout: MIN_S, or STEPS times the longest step so far, if that is more
ALIVE_EVERY_S = 1.0
ABORT_S = 3
SPIN, NAP_S = 2000, 1e-4  # polls without a pause, then the pause between polls, as ranks may share cores


class MPIRanks(Ranks):
    """The ranks of a communicator of mpi4py.

    divide    split the prototxt's batch among the ranks instead of using it on each
    patience  timeout in s for a rank in a step; by default derived from the duration of the steps
    """

    def __init__(self, comm: Any, divide: bool = False, patience: float | None = None) -> None:
        from mpi4py import MPI

        self._mpi, self._comm = MPI, comm.Dup()
        self.rank, self.count, self.divide = comm.Get_rank(), comm.Get_size(), divide
        on_this_machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
        self.on_machine = on_this_machine.Get_size()
        on_this_machine.Free()
        self.patience = patience
        self._longest: float | None = None  # duration of the longest step so far
        self._since: float | None = None  # time of the last agreement; None if other work followed
        self._asked = 0
        self._agreed: NetlibError | None = None  # an error that all ranks raise
        self._last_heartbeat = 0.0
        self._heartbeats: list[Any] = []
        self._means = Means(comm.Dup(), self._wait)
        self._gradients: Gradients | None = None
        self._under_way: Averaging | None = None

    # ------------------------------------------------------------------------------------------ agreement

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """Compare the facts of all ranks."""
        self._exchange(0.0, None, None)
        everyone: list[dict[str, Any]] = self._exchange_values(dict(facts))
        for rank, other in enumerate(everyone):
            for name, value in everyone[0].items():
                if other.get(name) != value:
                    theirs, own = map(_short, _different(other.get(name), value))
                    raise self._record(
                        f"rank {rank} has another {name} than rank 0: {theirs}, not {own}; expected the same on all"
                    )

    def of_root(self, number: int) -> int:
        """Exchange all numbers and return that of rank 0."""
        self._exchange(0.0, None, None)
        return int(self._exchange_values(number)[0])

    def agree(self, loss: float, request: Request | None, checksum: int | None) -> float:
        """Exchange the five numbers once."""
        table = self._exchange(loss, request, checksum)
        now = time.monotonic()
        if self._since is not None:
            self._longest = max(self._longest or 0.0, now - self._since)
        self._since = now
        self._asked = max(int(table[0, ASKED]), STOP * int(table[:, ASKED].max() == STOP))
        different = np.flatnonzero(table[:, CHECKSUM] != table[0, CHECKSUM])
        if len(different):
            self._settle(table)
            raise self._record(
                f"the parameters of rank {different[0]} differ from those of rank 0: faulty memory, a different "
                "processor, or a callback that changed them; the last snapshot is untouched"
            )
        return float(table[:, LOSS].mean())

    def fail(self, error: Exception) -> Exception:
        """Report the failure instead of the message that the others wait for."""
        if error is not self._agreed:
            try:
                self._exchange(0.0, None, None, failed=error)
            except NetlibError as agreed:
                return agreed
        return error

    def _record(self, message: str, kind: type[NetlibError] = NetlibError) -> NetlibError:
        """Remember and return an error that every rank raises."""
        self._agreed = kind(message)
        return self._agreed

    def asked(self, own: Request | None) -> Request | None:
        """The request that the last exchange agreed on."""
        return REQUESTS[self._asked]

    def from_root(self, own: Request | None) -> Request | None:
        """Exchange the five numbers and return the request of rank 0."""
        self._since = None  # the work of rank 0 before this does not count as a step
        return REQUESTS[int(self._exchange(0.0, own, None)[0, ASKED])]

    def gather(self, value: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Exchange all values; rank 0 keeps those of the others."""
        self._exchange(0.0, None, None)
        everyone: list[dict[str, Any]] = self._exchange_values(dict(value))
        return everyone[1:] if self.rank == 0 else []

    def alive(self, seconds: float = 0.0) -> None:
        """Send a heartbeat to the other ranks, at most once every ALIVE_EVERY_S."""
        now = time.monotonic()
        if self.rank == 0 and (seconds or now - self._last_heartbeat > ALIVE_EVERY_S):
            self._last_heartbeat = now
            self._heartbeats = [request for request in self._heartbeats if not request.Test()]  # keeps buffers alive
            self._heartbeats += [self._comm.Isend(np.array([seconds]), r, ALIVE) for r in range(1, self.count)]

    def _exchange(
        self, loss: float, request: Request | None, checksum: int | None, failed: Exception | None = None
    ) -> Array:
        """Exchange the five numbers of all ranks; returns (N, 5). If a rank failed, raises its error on every rank."""
        own = np.array([loss, REQUESTS.index(request), failed is not None,
                        NO_CHECKSUM if checksum is None else checksum, self._under_way is not None])
        table = np.zeros((self.count, len(own)))
        table[self.rank] = own
        if self.rank == 0:
            waiting = [self._comm.Irecv(table[r], r, TO_ROOT) for r in range(1, self.count)]
            self._wait(waiting)
            self._wait([self._comm.Isend(table, r, TO_ALL) for r in range(1, self.count)])
        else:
            self._wait([self._comm.Isend(own, 0, TO_ROOT), self._comm.Irecv(table, 0, TO_ALL)])
        if table[:, FAILED].any():
            first = int(table[:, FAILED].argmax())
            everyone = self._exchange_values([type(failed).__name__, _text_of(failed)])
            kind, text = everyone[first]
            where = "" if all(other == everyone[0] for other in everyone) else f"rank {first}: "
            self._settle(table)
            raise self._record(where + text, ERRORS.get(kind, NetlibError))
        return table

    def _exchange_values(self, own: Any) -> list[Any]:
        """Exchange values of all ranks as JSON."""
        text = json.dumps(own).encode()
        sizes = np.zeros(self.count, dtype=np.int64)
        self._wait([self._comm.Iallgather(np.array([len(text)], dtype=np.int64), sizes)])
        texts = np.zeros(int(sizes.sum()), dtype=np.uint8)
        places = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        mine = np.frombuffer(text, dtype=np.uint8)
        self._wait([self._comm.Iallgatherv(mine, [texts, sizes, places, self._mpi.BYTE])])
        return [json.loads(texts[at : at + n].tobytes()) for at, n in zip(places, sizes)]

    # ------------------------------------------------------------------------------------------ means

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays by their means, summed in the order of the ranks."""
        self._means.average(arrays)

    def begin_steps(self, gradients: Gradients) -> None:
        """Allocate the buffers; the time since the last step does not count as a step."""
        self._gradients, self._since = gradients, None
        for blobs in gradients.parts:
            self._means.buffers([blob.diff for blob in blobs])

    def finish_gradients(self) -> None:
        """Average the gradients in the order of the ranks, or finish doing so."""
        (self._under_way or Averaging(self._means, self._of_steps.parts)).finish()
        self._under_way = None

    @property
    def _of_steps(self) -> Gradients:
        assert self._gradients is not None, "begin_steps comes first"
        return self._gradients

    def _settle(self, table: Array) -> None:
        """Finish averages that some ranks began before all of them received an error, as they cannot be cancelled."""
        if table[:, UNDER_WAY].any():
            self.finish_gradients()

    # ------------------------------------------------------------------------------------------ waiting

    def _wait(self, requests: Requests, seconds: float | None = None) -> bool:
        """Wait for requests, at most ``seconds``; end all ranks on a timeout. Returns whether all are complete."""
        try:
            return self._poll(requests) if seconds is None else self._poll_for(requests, seconds)
        except self._mpi.Exception as error:  # some MPI libraries detect that a rank is gone
            self._give_up("another rank", f"({reason_of(error)})")
            raise

    def _poll_for(self, requests: Requests, seconds: float) -> bool:
        until = time.monotonic() + seconds
        while not (done := bool(self._mpi.Request.Testall(requests))) and time.monotonic() < until:
            pass
        return done

    def _poll(self, requests: Requests) -> bool:
        begun, polls, limit = time.monotonic(), 0, self._limit
        while not self._mpi.Request.Testall(requests):
            polls += 1
            if polls < SPIN:
                continue
            time.sleep(NAP_S)
            if self.rank and self._comm.Iprobe(0, ALIVE):
                seconds = np.zeros(1)
                self._comm.Recv(seconds, 0, ALIVE)
                if seconds[0] == ROLL_CALL:
                    self._comm.Isend(seconds, 0, HERE).Wait()
                else:
                    begun, limit = time.monotonic(), max(self._limit, seconds[0])
            waited = time.monotonic() - begun
            if self.rank == 0 and waited > limit:
                self._give_up(self._silent(limit / 10), f"for {waited:.0f} s")
            if self.rank and waited > limit * (1.25 + 0.05 * min(self.rank, 10)):  # rank 0 reports first
                self._give_up("rank 0", f"for {waited:.0f} s")
        return True

    def _silent(self, seconds: float) -> str:
        """Ranks that do not answer a roll call of rank 0."""
        self.alive(ROLL_CALL)
        until = time.monotonic() + min(seconds, 1.0)
        silent = list(range(1, self.count))
        while silent and time.monotonic() < until:
            time.sleep(NAP_S)
            silent = [rank for rank in silent if not self._comm.Iprobe(rank, HERE)]
        return f"rank{'s' * (len(silent) > 1)} {', '.join(map(str, silent))}" if silent else "another rank"

    @property
    def _limit(self) -> float:
        if self._longest is None:
            return max(START_S, self.patience or 0.0)
        return max(MIN_S, STEPS * self._longest) if self.patience is None else self.patience

    def _give_up(self, who: str, why: str) -> None:
        message = f"no response from {who} {why}; all ranks end, the last snapshot is untouched"
        print(message, file=sys.stderr, flush=True)
        with open(os.devnull, "w") as nowhere:  # Abort may hang on a broken network; this then ends the process
            faulthandler.dump_traceback_later(ABORT_S, exit=True, file=nowhere)
            self._comm.Abort(1)


def _text_of(error: Exception | None) -> str:
    return str(error) if isinstance(error, NetlibError) else f"{type(error).__name__}: {reason_of(error)}"


def _different(a: Any, b: Any) -> tuple[Any, Any]:
    """Reduce two lists of lists to the items that differ."""
    if not (isinstance(a, list) and isinstance(b, list) and len(a) == len(b) and isinstance(a[0], list)):
        return a, b
    pairs = [(x, y) for x, y in zip(a, b) if x != y]
    return [x for x, _ in pairs], [y for _, y in pairs]


def _short(value: Any, max_length: int = 120) -> str:
    text = json.dumps(value)
    return text if len(text) <= max_length else text[: max_length - 3] + "..."
