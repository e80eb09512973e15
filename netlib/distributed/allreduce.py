"""Means over the ranks of MPI, in the order of the ranks, so that a training repeats itself bit for bit.

Arrays lie in one flat buffer, in N pieces. In a first round rank r is sent piece r by every rank; it adds them up,
first rank to last, and divides by N; in a second round it sends the mean to all. That is 2 (N - 1) / N times the bytes
of the arrays out of and into every rank, as in the best algorithms for sums (Thakur, Rabenseifner and Gropp 2005,
Sec. 4).

Gradients come in parts, those of the last layers first, and are on their way while the layers before them still run
backwards (``Averaging``). The network works meanwhile, but most MPI libraries move data only when they are called, so
between layers somebody must look. A thread that looks all the time was tried, and was slower than not to overlap: it
takes the interpreter, and the processor, from the layers.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from netlib.blob import Array, Blob
from netlib.system import memory

LOOK_S = 2e-4  # with less, little is moved between two layers; with more, slow networks hold up the layers
Requests = list[Any]  # of MPI
ROUNDS = 2  # of a mean


class Wait(Protocol):
    """Waits until requests are done, or for so many s; are they done?"""

    def __call__(self, requests: Requests, seconds: float | None = None) -> bool: ...  # noqa: D102


class Buffers:
    """Memory for arrays of these shapes, of N ranks.

    flat    all arrays, one after the other, and then nothing, in N pieces
    places  where each array lies in it
    pieces  one piece of every rank
    mean    of these
    """

    def __init__(self, arrays: Sequence[Array], count: int) -> None:
        sizes = [array.size for array in arrays]
        piece = -(-sum(sizes) // count)
        self.flat, self.pieces = memory.zeros((2, count, piece), arrays[0].dtype)
        self.mean = memory.zeros((piece,), arrays[0].dtype)
        cut = np.split(self.flat.reshape(-1), np.cumsum(sizes))
        self.places = [part.reshape(array.shape) for part, array in zip(cut, arrays)]


class Means:
    """Takes means over the ranks of a communicator."""

    def __init__(self, comm: Any, wait: Wait) -> None:
        self.comm, self.wait = comm, wait
        self._buffers: dict[Any, Buffers] = {}

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays, of one dtype, by their means."""
        for requests in self.rounds(arrays) if arrays else ():
            self.wait(requests)

    def buffers(self, arrays: Sequence[Array]) -> Buffers:
        """Memory for such arrays. Raises OutOfMemoryError."""
        key = (arrays[0].dtype, *(array.shape for array in arrays))
        if key not in self._buffers:
            self._buffers[key] = Buffers(arrays, self.comm.Get_size())
        return self._buffers[key]

    def rounds(self, arrays: Sequence[Array]) -> Iterator[Requests]:
        """Replace arrays by their means; yields the requests of each round, and goes on when they are done."""
        own = self.buffers(arrays)
        for place, array in zip(own.places, arrays):
            place[...] = array
        yield [self.comm.Ialltoall(own.flat, own.pieces)]
        own.mean[...] = own.pieces[0]
        for other in own.pieces[1:]:
            own.mean += other
        own.mean /= len(own.pieces)
        yield [self.comm.Iallgather(own.mean, own.flat)]
        for place, array in zip(own.places, arrays):
            array[...] = place


class Averaging:
    """Means of parts of gradients, which are taken one after the other while the later parts are still computed."""

    def __init__(self, means: Means, parts: Sequence[Sequence[Blob]]) -> None:
        self._wait = means.wait
        self._rounds = (requests for blobs in parts for requests in means.rounds([blob.diff for blob in blobs]))
        self._requests: Requests = []
        self._begun = self._complete = 0  # rounds

    def look(self, complete: int | None = None) -> None:
        """Let MPI move data, for a moment, and begin what can be begun.

        complete  so many parts will not change any more; None: as many as before
        """
        if complete is not None:
            self._complete = ROUNDS * complete
        while self._wait(self._requests, LOOK_S) and self._begun < self._complete:
            self._requests = next(self._rounds)
            self._begun += 1

    def finish(self) -> None:
        """All parts are complete; returns when all are means."""
        for requests in itertools.chain([self._requests], self._rounds):
            self._wait(requests)
