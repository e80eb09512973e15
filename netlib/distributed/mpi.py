"""Ranks over MPI (mpi4py): how gradients are summed, how ranks agree, and how all end when one does.

    mpiexec -n 4 python -m mpi4py tools/train.py SOLVER

**Means** of the gradients are taken in the order of the ranks (allreduce.py). On several machines they begin while
layers still run backwards.

**Agreement**: then every rank tells rank 0 five numbers (the loss, what it was asked for, whether it failed, a
checksum, whether averages are under way), and rank 0 tells all of them to all. So a signal that reaches the ranks in
different steps stops all after the same one, and an error of one rank is the error of all.

**Waiting** is limited: a rank that nobody hears of ends the others, too. Nothing here blocks: whoever waits looks again
and again, at the clock, and whether rank 0 is busy (``alive``) or calls the roll: who does not answer is named.
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
from netlib.distributed.allreduce import Averaging, Means, Requests
from netlib.distributed.gradients import Gradients
from netlib.distributed.ranks import Ranks
from netlib.engine.plain import Passed
from netlib.errors import DataError, DivergenceError, NetlibError, WeightsError, reason_of

REQUESTS = (None, "snapshot", "stop")
STOP = REQUESTS.index("stop")
ERRORS: dict[str, type[NetlibError]] = {
    cls.__name__: cls for cls in (NetlibError, DataError, DivergenceError, WeightsError)
}
LOSS, ASKED, FAILED, CHECKSUM, UNDER_WAY = range(5)  # the five numbers
NO_CHECKSUM = -1.0
TO_ROOT, TO_ALL, ALIVE, HERE = range(1, 5)  # tags
ROLL_CALL = -1.0  # in the place of seconds
START_S = 120.0  # that ranks wait for each other at first
LEAST_S, STEPS = 10.0, 20.0  # later: so long, or so many of the longest steps so far
ALIVE_EVERY_S = 1.0
ABORT_S = 3
SPIN, NAP_S = 2000, 1e-4  # looks without a pause, and the pause between later ones: cores may be shared


class MPIRanks(Ranks):
    """The ranks of a communicator of mpi4py.

    divide    the prototxt's batch is that of all ranks together
    patience  how many s to wait for a rank in a step; by default by the length of the steps
    """

    def __init__(self, comm: Any, divide: bool = False, patience: float | None = None) -> None:
        from mpi4py import MPI

        self._mpi, self._comm = MPI, comm.Dup()
        self.rank, self.count, self.divide = comm.Get_rank(), comm.Get_size(), divide
        on_this_machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
        self.beside = on_this_machine.Get_size()
        on_this_machine.Free()
        self.patience = patience
        self._longest: float | None = None  # of the steps so far
        self._since: float | None = None  # when the last step was agreed on, and nothing has been done since
        self._asked = 0
        self._agreed: NetlibError | None = None  # an error that all ranks know of
        self._told = 0.0  # when the others were last told that rank 0 is alive
        self._telling: list[Any] = []
        self._means = Means(comm.Dup(), self._wait)
        self._gradients: Gradients | None = None  # of the steps
        self._under_way: Averaging | None = None

    # ------------------------------------------------------------------------------------------ agreement

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """All tell all their facts."""
        self._exchange(0.0, None, None)
        everyone: list[dict[str, Any]] = self._exchange_values(dict(facts))
        for rank, other in enumerate(everyone):
            for name, value in everyone[0].items():
                if other.get(name) != value:
                    theirs, ours = map(_short, _different(other.get(name), value))
                    raise self._known(
                        f"rank {rank} has another {name} than rank 0: {theirs}, not {ours}; expected the same on all"
                    )

    def of_root(self, number: int) -> int:
        """All tell all theirs."""
        self._exchange(0.0, None, None)
        return int(self._exchange_values(number)[0])

    def agree(self, loss: float, asked: str | None, checksum: int | None) -> float:
        """One round of the five numbers."""
        table = self._exchange(loss, asked, checksum)
        now = time.monotonic()
        if self._since is not None:
            self._longest = max(self._longest or 0.0, now - self._since)
        self._since = now
        self._asked = max(int(table[0, ASKED]), STOP * int(table[:, ASKED].max() == STOP))
        different = np.flatnonzero(table[:, CHECKSUM] != table[0, CHECKSUM])
        if len(different):
            self._settle(table)
            raise self._known(
                f"the parameters of rank {different[0]} are not those of rank 0 any more: its memory or its processor "
                "computes something else, or a callback changed them; the last snapshot is untouched"
            )
        return float(table[:, LOSS].mean())

    def fail(self, error: Exception) -> Exception:
        """In the place of what the others are waiting for."""
        if error is not self._agreed:
            try:
                self._exchange(0.0, None, None, failed=error)
            except NetlibError as agreed:
                return agreed
        return error

    def _known(self, message: str, kind: type[NetlibError] = NetlibError) -> NetlibError:
        """An error that every rank raises."""
        self._agreed = kind(message)
        return self._agreed

    def asked(self, own: str | None) -> str | None:
        """As the last round said."""
        return REQUESTS[self._asked]

    def from_root(self, own: str | None) -> str | None:
        """One round of the five numbers."""
        self._since = None  # what rank 0 did is no step
        return REQUESTS[int(self._exchange(0.0, own, None)[0, ASKED])]

    def gather(self, value: Mapping[str, Any]) -> list[dict[str, Any]]:
        """All tell all, and rank 0 keeps it."""
        self._exchange(0.0, None, None)
        everyone: list[dict[str, Any]] = self._exchange_values(dict(value))
        return everyone[1:] if self.rank == 0 else []

    def alive(self, seconds: float = 0.0) -> None:
        """A message to the others, now and then."""
        now = time.monotonic()
        if self.rank == 0 and (seconds or now - self._told > ALIVE_EVERY_S):
            self._told = now
            self._telling = [request for request in self._telling if not request.Test()]  # they keep their messages
            self._telling += [self._comm.Isend(np.array([seconds]), r, ALIVE) for r in range(1, self.count)]

    def _exchange(self, loss: float, asked: str | None, checksum: int | None, failed: Exception | None = None) -> Array:
        """The five numbers of all ranks (N, 5). Raises, on every rank, what a rank has failed with."""
        own = np.array([loss, REQUESTS.index(asked), failed is not None,
                        NO_CHECKSUM if checksum is None else checksum, self._under_way is not None])  # fmt: skip
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
            raise self._known(where + text, ERRORS.get(kind, NetlibError))
        return table

    def _exchange_values(self, own: Any) -> list[Any]:
        """What every rank has to say, as JSON."""
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
        """In the order of the ranks."""
        self._means.average(arrays)

    def begin_steps(self, gradients: Gradients) -> None:
        """What passed since the last step is no step."""
        self._gradients, self._since = gradients, None
        for blobs in gradients.parts:
            self._means.buffers([blob.diff for blob in blobs])

    def begin_gradients(self) -> Passed | None:
        """Those of the last layers are averaged while the first ones still run backwards, where ranks are on several
        machines; on one, the processors would move the bytes, and they have enough to do."""
        if self.beside == self.count:
            return None
        gradients = self._of_steps
        under_way = self._under_way = Averaging(self._means, gradients.parts)
        return lambda layer: under_way.look(None if layer is None else gradients.complete(layer))

    def finish_gradients(self) -> None:
        """In the order of the ranks."""
        (self._under_way or Averaging(self._means, self._of_steps.parts)).finish()
        self._under_way = None

    @property
    def _of_steps(self) -> Gradients:
        assert self._gradients is not None, "begin_steps comes first"
        return self._gradients

    def _settle(self, table: Array) -> None:
        """What some ranks have begun to average, before all of them heard of an error, cannot be taken back."""
        if table[:, UNDER_WAY].any():
            self.finish_gradients()

    # ------------------------------------------------------------------------------------------ waiting

    def _wait(self, requests: Requests, seconds: float | None = None) -> bool:
        """Until all are done, or for so long; ends all ranks if they take too long. Are they done?"""
        try:
            return self._look(requests) if seconds is None else self._look_for(requests, seconds)
        except self._mpi.Exception as error:  # a library may notice that one is gone
            self._give_up("another rank", f"({reason_of(error)})")
            raise

    def _look_for(self, requests: Requests, seconds: float) -> bool:
        until = time.monotonic() + seconds
        while not (done := bool(self._mpi.Request.Testall(requests))) and time.monotonic() < until:
            pass
        return done

    def _look(self, requests: Requests) -> bool:
        begun, looks, limit = time.monotonic(), 0, self._limit
        while not self._mpi.Request.Testall(requests):
            looks += 1
            if looks < SPIN:
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
            if self.rank and waited > limit * (1.25 + 0.05 * min(self.rank, 10)):  # rank 0 would have spoken first
                self._give_up("rank 0", f"for {waited:.0f} s")
        return True

    def _silent(self, seconds: float) -> str:
        """Which ranks are not even waiting; rank 0 asks all."""
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
        return max(LEAST_S, STEPS * self._longest) if self.patience is None else self.patience

    def _give_up(self, who: str, why: str) -> None:
        print(f"no sign of {who} {why}; all ranks end, the last snapshot is untouched", file=sys.stderr, flush=True)
        with open(os.devnull, "w") as nowhere:  # MPI may wait for a network that is cut: this ends the process then
            faulthandler.dump_traceback_later(ABORT_S, exit=True, file=nowhere)
            self._comm.Abort(1)


def _text_of(error: Exception | None) -> str:
    return str(error) if isinstance(error, NetlibError) else f"{type(error).__name__}: {reason_of(error)}"


def _different(a: Any, b: Any) -> tuple[Any, Any]:
    """Of two lists of lists, those that differ."""
    if not (isinstance(a, list) and isinstance(b, list) and len(a) == len(b) and isinstance(a[0], list)):
        return a, b
    pairs = [(x, y) for x, y in zip(a, b) if x != y]
    return [x for x, _ in pairs], [y for _, y in pairs]


def _short(value: Any, most: int = 120) -> str:
    text = json.dumps(value)
    return text if len(text) <= most else text[: most - 3] + "..."
