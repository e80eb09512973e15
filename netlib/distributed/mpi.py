"""Ranks over MPI (mpi4py): means of gradients, agreement on losses, requests and errors.

    mpiexec -n 4 python -m mpi4py tools/train.py SOLVER

**Means** are summed in the order of the ranks, so that trainings give bitwise equal results. Arrays
are packed into one flat buffer of N shards. In the first round every rank sends shard r to rank r,
which sums them from first rank to last and divides by N; in the second it sends the mean to all.
Each rank sends and receives 2 (N - 1) / N times the bytes of the arrays, which is optimal
(Thakur, Rabenseifner and Gropp 2005, Sec. 4).

**Agreement**: after each step every rank sends its loss, request, failure and checksum to all. A
signal that reaches the ranks in different steps therefore stops all of them after the same step,
and an error of one rank is raised on all. If a rank ends in another way, ``-m mpi4py`` and the
launcher end the others.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.distributed import ranks
from netlib.distributed.ranks import RankOfLayers, Ranks, Request, Shard
from netlib.errors import DataError, DivergenceError, NetlibError, WeightsError, reason_of
from netlib.net import Net
from netlib.system import memory

ERRORS: dict[str, type[NetlibError]] = {
    cls.__name__: cls for cls in (NetlibError, DataError, DivergenceError, WeightsError)
}
COMPARED_EVERY = 100  # iterations between comparisons of the parameters
# polls without a pause, then the pause between polls, as ranks may share cores
SPIN, NAP_S = 2000, 1e-4


class MPIRanks(Ranks):
    """The ranks of a communicator of mpi4py.

    ``divide`` splits the prototxt's batch among them instead of using it on each.
    """

    def __init__(self, comm: Any, divide: bool = False) -> None:
        from mpi4py import MPI

        self._comm = comm.Dup()
        self.rank = comm.Get_rank()
        self.count = comm.Get_size()
        self.shard = Shard(self.rank, self.count, divide)
        self.layer_hook = RankOfLayers(self.shard)
        on_this_machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
        self.on_machine = on_this_machine.Get_size()
        on_this_machine.Free()
        self._asked: Request | None = None
        self._agreed: NetlibError | None = None  # an error that all ranks raise
        self._buffers: dict[Any, tuple[Array, Array]] = {}
        ranks.latest = self

    # ------------------------------------------------------------------------------------ agreement

    def everyone(self, value: Any) -> list[Any]:
        """Exchange all values."""
        return self._exchange(value)

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """Compare the facts of all ranks."""
        everyone = self.everyone(dict(facts))
        for rank, other in enumerate(everyone):
            for name, value in everyone[0].items():
                if other.get(name) != value:
                    theirs, own = map(_short, _different(other.get(name), value))
                    raise self._record(
                        f"rank {rank} has another {name} than rank 0: {theirs}, not {own}; expected the same on all"
                    )

    def agree(
        self,
        loss: float,
        request: Request | None,
        net: Net | None = None,
        iteration: int | None = None,
    ) -> float:
        """Exchange once, then average."""
        trained = (
            [param for param in net.learnable if param.spec.lr_mult]
            if net and iteration is not None
            else []
        )
        is_compared = iteration is not None and iteration % COMPARED_EVERY == 0
        own = (loss, request, ranks.checksum(trained) if is_compared else 0)
        losses, requests, checksums = zip(*self._exchange(own))
        self._asked = "stop" if "stop" in requests else requests[0]
        different = [rank for rank, other in enumerate(checksums) if other != checksums[0]]
        if different:
            raise self._record(
                f"the parameters of rank {different[0]} differ from those of rank 0: faulty memory, a different "
                "processor, or a callback that changed them; the last snapshot is untouched"
            )
        self.average([param.blob.diff for param in trained])
        self.average(ranks.moving(net) if net else [])
        return float(np.mean(losses))

    def asked(self, own: Request | None) -> Request | None:
        """The request that the last exchange agreed on."""
        return self._asked

    def at_root(
        self, work: Callable[[], object], request: Callable[[], Request | None] = lambda: None
    ) -> None:
        """Work at rank 0 while the others wait."""
        with self.together():
            if self.rank == 0:
                work()
            self._asked = self._exchange(request())[0]

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

    def fail(self, error: Exception) -> Exception:
        """Raise the error on the other ranks, in what they exchange next, unless all ranks
        raise it already.
        """
        if error is self._agreed:
            return error
        try:
            self._exchange(failed=error)
        except NetlibError as agreed:
            return agreed
        return error

    def _record(self, message: str, kind: type[NetlibError] = NetlibError) -> NetlibError:
        """An error that all ranks raise."""
        self._agreed = kind(message)
        return self._agreed

    def _exchange(self, value: Any = None, failed: Exception | None = None) -> list[Any]:
        """Exchange values of all ranks; returns them in order.

        If a rank failed, raises its error on every rank.
        """
        failure = None
        if failed is not None:
            kind = type(failed).__name__
            is_ours = isinstance(failed, NetlibError)
            failure = kind, str(failed) if is_ours else f"{kind}: {reason_of(failed)}"
        self._wait(self._comm.Ibarrier())  # after which none waits for long
        everyone = self._comm.allgather((value, failure))
        failures = [failure for _, failure in everyone]
        for rank, failure in enumerate(failures):
            if failure is not None:
                kind, text = failure
                where = "" if all(other == failure for other in failures) else f"rank {rank}: "
                raise self._record(where + text, ERRORS.get(kind, NetlibError))
        return [value for value, _ in everyone]

    # ---------------------------------------------------------------------------------------- means

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays of one dtype by their means, summed in the order of the ranks."""
        if not arrays:
            return
        ends = np.cumsum([array.size for array in arrays])
        flat, pieces = self._buffers_of(int(ends[-1]), arrays[0].dtype)
        places = [
            part.reshape(array.shape)
            for part, array in zip(np.split(flat.reshape(-1), ends), arrays)
        ]
        for place, array in zip(places, arrays):
            place[...] = array
        self._wait(self._comm.Ialltoall(flat, pieces))
        mean = pieces[0]
        for other in pieces[1:]:
            mean += other
        mean /= self.count
        self._wait(self._comm.Iallgather(mean, flat))
        for place, array in zip(places, arrays):
            array[...] = place

    def _buffers_of(self, size: int, dtype: np.dtype[Any]) -> tuple[Array, Array]:
        """Buffers for ``size`` values, padded to N shards, and for a shard of every rank.

        Raises OutOfMemoryError.
        """
        if (size, dtype) not in self._buffers:
            flat, pieces = memory.zeros((2, self.count, -(-size // self.count)), dtype)
            self._buffers[size, dtype] = flat, pieces
        return self._buffers[size, dtype]

    def _wait(self, request: Any) -> None:
        """Wait for an MPI request, with pauses: the layers of rank 0 may need the processor."""
        polls = 0
        while not request.Test():
            polls += 1
            if polls > SPIN:
                time.sleep(NAP_S)


def _different(a: Any, b: Any) -> tuple[Any, Any]:
    """Reduce two lists of lists to the items that differ."""
    if not (
        isinstance(a, list) and isinstance(b, list) and len(a) == len(b) and isinstance(a[0], list)
    ):
        return a, b
    pairs = [(x, y) for x, y in zip(a, b) if x != y]
    return [x for x, _ in pairs], [y for _, y in pairs]


def _short(value: Any, max_length: int = 120) -> str:
    text = json.dumps(value)
    return text if len(text) <= max_length else text[: max_length - 3] + "..."
