"""Ranks: several processes that train one net together, each on its own rows ("data parallel").

    solver = netlib.get_solver("solver.prototxt", ranks=MPIRanks(MPI.COMM_WORLD))

Every rank holds the whole net and runs the prototxt's batch, so N ranks make the batch N times as
large: row k of the data goes to rank k mod N, gradients are averaged over the ranks, and every rank
makes the same update. All ranks call the same methods of their solvers; rank 0 alone tests, logs
and writes snapshots.

``Ranks`` defines the interface and is a single process, rank 0 of 1; ``mpi.MPIRanks``
implements several.
"""

from __future__ import annotations

import contextlib
import functools
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from netlib.blob import Array
from netlib.building.params import Param
from netlib.graph import LayerHook
from netlib.layer import Layer
from netlib.net import Net
from netlib.proto import schema
from netlib.proto.messages import SolverParameter

Request = Literal["stop", "snapshot"]  # to a solver


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
        """Number of rows that a rank reads of a prototxt's batch.

        Raises ValueError if it cannot be divided.
        """
        if not self.divide:
            return size
        if size % self.count:
            raise ValueError(
                f"a batch of {size} cannot be divided among {self.count} ranks; expected a multiple of {self.count}"
            )
        return size // self.count

    def places(self, size: int) -> Iterator[int | None]:
        """For every row of a step, its index in this rank's batch of ``size``, or None if another
        rank reads it.
        """
        return (
            k // self.count if k % self.count == self.rank else None
            for k in range(size * self.count)
        )

    def rows(self, done: int, take: int) -> tuple[slice, slice]:
        """Of ``take`` consecutive rows that follow ``done`` rows of a step: the rows of this rank,
        and their indices in its batch.
        """
        first = (self.rank - done) % self.count
        place = (done + first) // self.count
        return slice(first, take, self.count), slice(
            place, place + len(range(first, take, self.count))
        )


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


class Ranks:
    """A single process.

    rank, count  the number of this process, and of all
    on_machine   number of ranks on this machine
    shard        the rows of the data that this rank reads
    layer_hook   called with each layer of the training net before and after its setup
    """

    rank, count, on_machine = 0, 1, 1
    shard: Shard = EVERY_ROW
    layer_hook: LayerHook | None = None

    def everyone(self, value: Any) -> list[Any]:
        """Return the JSON values of all ranks in order."""
        return [value]

    def introduce(self, facts: Mapping[str, Any]) -> None:
        """Raise NetlibError on every rank unless the facts about the training are
        equal on all ranks.
        """

    def agree(
        self,
        loss: float,
        request: Request | None,
        net: Net | None = None,
        iteration: int | None = None,
    ) -> float:
        """Agree after a pass; returns the mean loss over the ranks.

        Averages the moving averages of the net and, if an iteration is given, its gradients.

        request    a request to this solver: "stop", "snapshot" or None
        iteration  the number of the iteration; in some, checksums of the trained
                   parameters are compared

        If a rank failed, raises its error on every rank. Raises NetlibError if checksums differ.
        """
        return loss

    def asked(self, own: Request | None) -> Request | None:
        """The request that counts after ``agree`` or ``at_root``: "stop" from any rank, or
        "snapshot" from rank 0.
        """
        return own

    def at_root(
        self, work: Callable[[], object], request: Callable[[], Request | None] = lambda: None
    ) -> None:
        """Do work that rank 0 does for all, such as writing files.

        Raises on all ranks what the work raises.

        Afterwards, the request of rank 0 counts.
        """
        work()

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Context manager: a NetlibError raised in it on one rank is raised on all."""
        yield

    def fail(self, error: Exception) -> Exception:
        """Report to the other ranks that this one failed. Returns the exception to raise."""
        return error


ALONE = Ranks()
# The last ranks of several that this process has made, for caffe.solver_rank and solver_count. They
# have no argument, as Caffe's own are values of the process, and layers of type Python call them.
latest = ALONE


def facts_of(param: SolverParameter, net: Net, iteration: int) -> dict[str, Any]:
    """Return the values, by name, that must be equal on all ranks before their first step."""
    reading = {layer.name: layer.reads() for layer in net.layers if hasattr(layer, "reads")}
    return {
        "solver prototxt": zlib.crc32(repr(param).encode()),
        "net prototxt": zlib.crc32(str(schema.to_tree(net.param)).encode()),
        **{f"data in layer {name!r}": reads for name, reads in reading.items() if reads},
        "engine": net.engine.name,
        "iteration": iteration,
        "parameters": checksum(net.learnable),
    }


def moving(net: Net) -> list[Array]:
    """The parameters that forward updates: moving averages."""
    return [blob.data for layer in net.layers if layer.moving for blob in layer.blobs]


def checksum(params: Sequence[Param]) -> int:
    """Checksum of the values of parameters."""
    return functools.reduce(lambda crc, param: zlib.crc32(param.blob.data.data, crc), params, 0)


def mean_outputs(net: Net, ranks: Ranks) -> Mapping[str, Array]:
    """Outputs of the net: their means over the ranks."""
    own = {name: net.blobs[name].data for name in net.outputs}
    if ranks.count == 1:
        return own
    everyone = ranks.everyone({name: y.tolist() for name, y in own.items()})
    means: dict[str, Array] = {}
    for name, y in own.items():
        arrays = [np.asarray(outputs[name]) for outputs in everyone]
        # false after layers that drop rows, such as Filter
        alike = all(array.shape == y.shape for array in arrays)
        means[name] = np.mean(arrays, axis=0) if alike else y
    return means
