"""Gradients of a net grouped into buckets, and means over MPI ranks.

Means are summed in the order of the ranks, so that training runs give bitwise equal results.

Arrays are packed into one flat buffer of N shards. In the first round every rank sends shard r to rank r, which sums
them from first rank to last and divides by N; in the second round it sends the mean to all. Each rank sends and
receives 2 (N - 1) / N times the bytes of the arrays, which is optimal (Thakur, Rabenseifner and Gropp 2005, Sec. 4).

Gradients come in buckets, those of the last layers first, and are sent while earlier layers still run backwards
(``Averaging``). Most MPI libraries move data only inside their calls, so the backward pass polls between layers. A
polling thread was slower than no overlap: it competes with the layers for the interpreter and the processor.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from netlib.blob import Array, Blob
from netlib.layer import Layer
from netlib.params import Param
from netlib.system import memory

POLL_S = 2e-4  # shorter moves little data between two layers; longer delays the layers on slow networks
Requests = list[Any]  # MPI requests
ROUNDS = 2  # rounds of messages per mean

MIN_BYTES = 2**20  # minimum size of a bucket: from this size on, transfer time exceeds the overhead of a message


class Wait(Protocol):
    """Waits for requests to complete, at most ``seconds`` if given. Returns whether all are complete."""

    def __call__(self, requests: Requests, seconds: float | None = None) -> bool: ...  # noqa: D102


class Buffers:
    """Buffers for the mean of arrays of these shapes over N ranks.

    flat    all arrays in sequence, padded to N shards
    places  the view of each array in ``flat``
    pieces  this rank's shard from every rank
    mean    mean of ``pieces``
    """

    def __init__(self, arrays: Sequence[Array], count: int) -> None:
        sizes = [array.size for array in arrays]
        piece = -(-sum(sizes) // count)
        self.flat, self.pieces = memory.zeros((2, count, piece), arrays[0].dtype)
        self.mean = memory.zeros((piece,), arrays[0].dtype)
        cut = np.split(self.flat.reshape(-1), np.cumsum(sizes))
        self.places = [part.reshape(array.shape) for part, array in zip(cut, arrays)]


class Means:
    """Computes means over the ranks of a communicator."""

    def __init__(self, comm: Any, wait: Wait) -> None:
        self.comm, self.wait = comm, wait
        self._buffers: dict[Any, Buffers] = {}

    def average(self, arrays: Sequence[Array]) -> None:
        """Replace arrays of one dtype by their means."""
        for requests in self.rounds(arrays) if arrays else ():
            self.wait(requests)

    def buffers(self, arrays: Sequence[Array]) -> Buffers:
        """Buffers for such arrays, allocated at the first call. Raises OutOfMemoryError."""
        key = (arrays[0].dtype, *(array.shape for array in arrays))
        if key not in self._buffers:
            self._buffers[key] = Buffers(arrays, self.comm.Get_size())
        return self._buffers[key]

    def rounds(self, arrays: Sequence[Array]) -> Iterator[Requests]:
        """Replace arrays by their means. Yields the requests of each round; the caller resumes when they are done."""
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
    """Averages buckets of gradients one after the other while the gradients of later buckets are still computed."""

    def __init__(self, means: Means, parts: Sequence[Sequence[Blob]]) -> None:
        self._wait = means.wait
        self._rounds = (requests for blobs in parts for requests in means.rounds([blob.diff for blob in blobs]))
        self._requests: Requests = []
        self._begun = self._complete = 0  # numbers of rounds that were started, and that may be started

    def poll(self, complete: int | None = None) -> None:
        """Let MPI move data briefly and start the next round if its bucket is complete.

        complete  number of buckets that will not change any more; None: as in the last call
        """
        if complete is not None:
            self._complete = ROUNDS * complete
        while self._wait(self._requests, POLL_S) and self._begun < self._complete:
            self._requests = next(self._rounds)
            self._begun += 1

    def finish(self) -> None:
        """Finish all buckets, which must be complete."""
        for requests in itertools.chain([self._requests], self._rounds):
            self._wait(requests)


class Gradients:
    """The gradients of a net in buckets, those of the last layers first.

    The buckets do not depend on how the layers are run, so all ranks have the same. Parameters that are not trained
    are in none of them.

    parts  per bucket, the parameters
    """

    def __init__(self, layers: Sequence[Layer], learnable: Sequence[Param], min_bytes: int = MIN_BYTES) -> None:
        self._place = {layer.name: i for i, layer in enumerate(layers)}
        self._first: list[int] = []  # index of the first layer of each bucket
        self.parts: list[list[Blob]] = []
        for param in reversed(learnable):  # the owner is the first layer that uses it: the last to add to its diff
            if param.spec.lr_mult == 0:
                continue
            place = self._place[param.layer]
            if not self.parts or (place < self._first[-1] and sum(blob.bytes for blob in self.parts[-1]) >= min_bytes):
                self.parts.append([])
                self._first.append(place)
            self.parts[-1].append(param.blob)
            self._first[-1] = place

    def complete(self, layer: Layer) -> int:
        """Number of complete buckets when this layer and all after it have run backwards."""
        return sum(first >= self._place[layer.name] for first in self._first)
