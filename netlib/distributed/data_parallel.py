"""Data-parallel training: the solvers of several ranks average gradients, and agree on losses, requests and errors.

    solver = netlib.get_solver("solver.prototxt", callbacks=[DataParallel(MPIRanks(MPI.COMM_WORLD))])

All ranks call the same methods of their solvers; rank 0 alone tests, logs and writes snapshots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from netlib.blob import Array
from netlib.distributed import consistency
from netlib.distributed import ranks as module_of_ranks
from netlib.distributed.allreduce import Gradients
from netlib.distributed.ranks import Ranks
from netlib.distributed.shard import RankOfLayers
from netlib.errors import NetlibError
from netlib.net import Net
from netlib.snapshots import snapshot
from netlib.training.callbacks import Callback, Request, Solver
from netlib.training.resume import moving


class DataParallel(Callback):
    """The callback of one rank's solver. It belongs before all others, which see errors that all ranks agree on.

    ranks  the ranks that train together (ranks.py)
    """

    def __init__(self, ranks: Ranks) -> None:
        self.ranks = ranks
        self.rank, self.count = ranks.rank, ranks.count
        self.layer_hook = RankOfLayers(ranks.shard)
        module_of_ranks.latest = ranks
        self._gradients: Gradients | None = None
        self._introduced = False
        self._checksum: int | None = None
        self._agreed: Request | None = None  # the request of the last agreement

    def seed(self, chosen: int) -> int:
        """The seed of rank 0."""
        return self.ranks.of_root(chosen)

    # ------------------------------------------------------------------------------------------ an iteration

    def on_step(self, solver: Solver) -> None:
        """Check once that the ranks are about to run the same training. Raises NetlibError."""
        if not self._introduced:
            self.ranks.introduce(consistency.traits_of(solver))
        self._introduced = True
        self._gradients = self._gradients or Gradients(solver.net.layers, solver.net.learnable)
        self.ranks.begin_steps(self._gradients)

    def on_start(self, solver: Solver) -> None:
        """Note the checksum of the parameters, in iterations in which they are compared."""
        self._checksum = consistency.checksum(solver)

    def on_loss(self, solver: Solver, loss: float, with_gradients: bool = True) -> float:
        """Agree on the mean loss and on requests; average gradients and moving averages."""
        loss = self.ranks.agree(loss, solver.requested, self._checksum)
        self._agreed, self._checksum = self.ranks.asked(solver.requested), None
        if with_gradients:
            self.ranks.finish_gradients()
        self.ranks.average(moving(solver.net))
        return loss

    def action(self, request: Request | None) -> Request | None:
        """What the ranks agreed on: a stop requested at any rank, a snapshot requested at rank 0."""
        return self._agreed

    # ------------------------------------------------------------------------------------------ what interrupts it

    def on_test_batch(self, solver: Solver) -> None:
        """Tell the waiting ranks that rank 0 is at work."""
        self.ranks.alive()

    def on_restore(self, solver: Solver) -> None:
        """Compare the ranks again before the next step."""
        self._introduced = False

    def on_error(self, solver: Solver, error: NetlibError) -> NetlibError:
        """Raise the error on all ranks."""
        agreed = self.ranks.fail(error)
        return agreed if isinstance(agreed, NetlibError) else error

    # ------------------------------------------------------------------------------------------ work of rank 0

    def at_root(self, solver: Solver, work: Callable[[], object], seconds: float = 0.0) -> None:
        """Work at rank 0 while the others wait. Raises on all ranks what the work raises."""
        with self.ranks.together():
            if self.rank == 0:
                self.ranks.alive(seconds)
                work()
        self._agreed = self.ranks.from_root(solver.requested)

    def outputs(self, net: Net, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """At rank 0, the means over the ranks."""
        return consistency.mean_outputs(net, self.ranks)

    def other_states(self, net: Net) -> Sequence[Mapping[str, Any]]:
        """At rank 0, the states of ranks 1 and up."""
        return self.ranks.gather(snapshot.as_plain(net.layer_states()))
