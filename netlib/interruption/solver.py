"""A solver that can be stopped at any time without loss of work."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from netlib.errors import DataError, WeightsError
from netlib.net import Net
from netlib.proto.messages import SolverParameter
from netlib.snapshots import hdf5_format, snapshot, weights
from netlib.solver import Solver
from netlib.training.resume import extra_state, undo_of

log = logging.getLogger("netlib")


class _StopError(Exception):
    """Stops the training after this iteration."""


class _TestInterruptedError(Exception):
    """Stops a test after this batch."""


class InterruptibleSolver(Solver):
    """A solver for long training runs.

    ``requested`` may be set to "stop" or "snapshot" at any time, by a signal handler or another thread; it takes effect
    after the current iteration. If data ends in the middle of an iteration, the iteration is rolled back.
    """

    def __init__(self, param: SolverParameter, source: str = "<solver>", **options: Any) -> None:
        self.requested: str | None = None
        self._undo: Callable[[], None] | None = None  # restores the nets to the start of the iteration
        self._snapshot_requested = False
        super().__init__(param, source, **options)

    # ------------------------------------------------------------------------------------------ training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter, then take the last snapshot and test. Returns False if a request stopped it early."""
        with self._snapshots_reserved():
            return super().solve(resume)

    @contextlib.contextmanager
    def _snapshots_reserved(self) -> Iterator[None]:
        """Context manager: no other process writes snapshots of this prefix. Checks that all layers can be stored."""
        p = self.param
        if not (p.snapshot or p.snapshot_after_train):
            yield
            return
        with snapshot.prefix_in_use(self.prefix):
            if p.snapshot_format == "HDF5":
                hdf5_format.check_names(weights.owned(self.net))
            extra_state(self)  # fails now, not after hours, if the state of a layer cannot be stored
            yield

    def _train(self, iterations: int) -> bool:
        try:
            return self.step(iterations)
        except DataError:
            if self._can_snapshot() and not self._is_saved():
                try:
                    self.snapshot()  # keeps the progress made before the data failed
                except WeightsError as error:
                    log.error("%s", error)
            raise

    def _can_snapshot(self) -> bool:
        return bool(self.param.snapshot or self.param.snapshot_after_train)

    def step(self, iterations: int) -> bool:
        """Make some updates. Returns False if a request stopped it early."""
        try:
            return super().step(iterations)
        except _StopError:
            self.requested = None
            self.snapshot()
            return False
        except DataError:
            if self._undo is not None:
                self._undo()
            raise
        finally:
            self._undo = None

    def _before_iteration(self) -> None:
        super()._before_iteration()
        nets = [self.net, *self.test_nets] if self._test_is_due() else [self.net]
        self._undo = undo_of(nets) if self._test_is_due() or any(map(_reads_files, nets)) else None

    def _before_gradients(self) -> None:
        if self._test_is_due() and self._requested_in_test() == "stop":
            assert self._undo is not None
            self._undo()  # a resume repeats the tests of this iteration with the same rows
            raise _StopError
        super()._before_gradients()

    def _forward_backward(self) -> float:
        loss = self._loss_and_gradients()
        self._undo = None
        return loss

    def _loss_and_gradients(self) -> float:
        return super()._forward_backward()

    def _after_update(self) -> None:
        super()._after_update()
        request = self._agreed_request()
        if request == "stop":
            raise _StopError
        if self.requested == request:
            self.requested = None
        self._snapshot_requested = request == "snapshot"

    def _snapshot_is_due(self) -> bool:
        return self._snapshot_requested or super()._snapshot_is_due()

    def _requested_in_test(self) -> str | None:
        """The request that takes effect after the tests of an iteration."""
        return self.requested

    def _agreed_request(self) -> str | None:
        """The request that takes effect after an update."""
        return self.requested

    # ------------------------------------------------------------------------------------------ tests

    def test_all(self) -> list[dict[str, Any]]:
        """Run the test nets until a request to stop; returns the mean of each output."""
        means = []
        for i in range(len(self.test_nets)):
            if self.requested == "stop":
                break
            means.append(self.test(i))
        return means

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net over test_iter batches; returns and logs the mean of each output, {} if stopped."""
        try:
            return super().test(number)
        except _TestInterruptedError:
            log.info("Test interrupted.")
            return {}

    def _after_test_batch(self) -> None:
        if self.requested == "stop":
            raise _TestInterruptedError


def _reads_files(net: Net) -> bool:
    """Whether reading data can fail in this net: a layer reads files or is a Python layer."""
    return any(hasattr(layer, "reads") or layer.type == "Python" for layer in net.layers)
