"""A solver for data-parallel training: averages gradients, and agrees on losses, requests and errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from netlib.blob import Array
from netlib.distributed import consistency
from netlib.distributed.allreduce import Gradients
from netlib.distributed.ranks import ALONE, Ranks, latest
from netlib.distributed.share import RankOfLayers
from netlib.interruption.solver import InterruptibleSolver
from netlib.net import Net
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState, SolverParameter
from netlib.snapshots import snapshot
from netlib.snapshots.solver_state import SolverState
from netlib.solver import Solver
from netlib.training import solver_parameter
from netlib.training.resume import moving, state_of

SNAPSHOT_S = 120.0  # timeout of the other ranks while one writes a snapshot


class DistributedSolver(InterruptibleSolver):
    """The solver of one rank. All ranks call the same methods; rank 0 alone tests, logs and writes snapshots.

    ranks  the ranks that train together (ranks.py)
    """

    def __init__(self, param: SolverParameter, source: str = "<solver>", ranks: Ranks = ALONE, **options: Any) -> None:
        self.ranks = ranks
        latest[:] = [ranks]
        self._introduced = False
        self._others: Sequence[Mapping[str, Any]] = ()  # at rank 0: layer states of the other ranks
        self._request_of_root: str | None = None  # request to rank 0 during the last tests
        super().__init__(param, source, **options)
        self._gradients = Gradients(self.net.layers, self.net.learnable)

    def _choose_seed(self, given: int | None) -> int:
        return self.ranks.of_root(super()._choose_seed(given))

    def _make_net(
        self, name: str, param: NetParameter, state: NetState, phase: schema.Phase, number: int, **options: Any
    ) -> Net:
        if phase == "TRAIN":
            options["layer_hook"] = RankOfLayers(self.ranks.share)
        return super()._make_net(name, param, state, phase, number, **options)

    # ------------------------------------------------------------------------------------------ training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter, then take the last snapshot and test. Returns False if a request stopped it early."""
        with self.ranks.together():
            return super().solve(resume) if self.ranks.rank == 0 else Solver.solve(self, resume)

    def step(self, iterations: int) -> bool:
        """Make some updates. Returns False if a request stopped it early."""
        self._introduce()
        with self.ranks.together():
            self.ranks.begin_steps(self._gradients)
        return super().step(iterations)

    def _introduce(self) -> None:
        """Check once that the ranks are about to run the same training. Raises NetlibError."""
        if not self._introduced and self.ranks.count > 1:
            with self.ranks.together():
                facts = consistency.traits_of(self)
            self.ranks.introduce(facts)
        self._introduced = True

    def _can_snapshot(self) -> bool:
        return self._introduced and super()._can_snapshot()

    def _loss_and_gradients(self) -> float:
        checksum = consistency.checksum(self)
        with self.ranks.together():
            loss = super()._loss_and_gradients()
        loss = self.ranks.agree(loss, self.requested, checksum)
        self.ranks.finish_gradients()
        self.ranks.average(moving(self.net))
        return loss

    def _backward(self, left: int, after: Callable[[Any], object] | None) -> None:
        self.net.run_backward(None if left else self.ranks.begin_gradients(), after)

    def _agreed_request(self) -> str | None:
        return self.ranks.asked(self.requested)

    def _requested_in_test(self) -> str | None:
        return self._request_of_root

    def _last_loss(self) -> float:
        with self.ranks.together():
            loss = super()._last_loss()
        loss = self.ranks.agree(loss, None, None)
        self.ranks.average(moving(self.net))
        return loss

    def _train_outputs(self) -> Mapping[str, Array]:
        return consistency.mean_outputs(self.net, self.ranks)

    # ------------------------------------------------------------------------------------------ work of rank 0

    def _at_root(self, do: Callable[[], Any]) -> str | None:
        """Run ``do`` at rank 0 while the others wait; returns the request to rank 0. Raises what ``do`` raises."""
        with self.ranks.together():
            if self.ranks.rank == 0:
                do()
        return self.ranks.from_root(self.requested)

    def test_all(self) -> list[dict[str, Any]]:
        """Run every test net at rank 0 while the others wait. Returns the mean of each output, at rank 0."""
        means: list[dict[str, Any]] = []
        test = super().test_all
        self._request_of_root = self._at_root(lambda: means.extend(test()))
        return means

    def _after_test_batch(self) -> None:
        self.ranks.alive()
        super()._after_test_batch()

    def _write(self, weights_path: Path, state_path: Path) -> None:
        states = snapshot.as_plain(self.net.layer_states()) if self.ranks.count > 1 else {}
        self._others = self.ranks.gather(states)
        write = super()._write
        self._at_root(lambda: write(weights_path, state_path))

    def _state(self, weights_path: Path) -> SolverState:
        self.ranks.alive(SNAPSHOT_S)
        return state_of(self, weights_path, self._others)

    def restore(self, path: str | Path) -> None:
        """Resume from a solver state; exact to the bit if netlib wrote it. Raises WeightsError."""
        super().restore(path)
        self._introduced = False


def get_solver(
    path: str | Path, seed: int | None = None, engine: str | None = None, python_layers: bool = True,
    ranks: Ranks | None = None, **changes: Any,
) -> InterruptibleSolver:  # fmt: skip
    """Create the solver of a prototxt file; ``changes`` replace its fields (``max_iter=10``). Raises NetlibError.

    ``python_layers=False`` rejects nets with layers of type Python. ``ranks`` (``mpi.MPIRanks``) train together.
    """
    param = solver_parameter.read(path, **changes)
    options: dict[str, Any] = {"seed": seed, "engine": engine, "python_layers": python_layers}
    if ranks is None:
        return InterruptibleSolver(param, str(path), **options)
    return DistributedSolver(param, str(path), ranks, **options)
