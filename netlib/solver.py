"""Solver: Caffe's training loop.

    solver = netlib.get_solver("solver.prototxt")
    solver.solve()                 train to the end
    solver.step(100)               or make some iterations

``iter`` always equals the number of updates made. Training logs the same lines as Caffe, to the
logger "netlib"; tools/train.py adds Caffe's time stamps. Further work is attached as functions:
``solver.on_update.append(function)``.
"""

from __future__ import annotations

import logging
import secrets
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from netlib import engine as engines
from netlib.distributed.ranks import ALONE, Ranks, facts_of, mean_outputs
from netlib.errors import DataError, DivergenceError, WeightsError
from netlib.files.paths import find
from netlib.net import Net, next_seed
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState, SolverParameter
from netlib.training import report, solver_parameter
from netlib.training.resume import Snapshots, Training, restore_state, undone_after
from netlib.updates import Update, learning_rate, steps_taken

log = logging.getLogger("netlib")
Function = Callable[[], object]


class Solver(Training):
    """Trains a net.

    param         SolverParameter
    net           the training net
    test_nets     nets for testing; they share the parameters of ``net``
    iter          number of updates made
    update        applies gradients to the weights (updates.py); its history has, per parameter, the
                  arrays of the rule
    smoothed      the losses of the last average_loss iterations
    ranks         the processes that train together (distributed/ranks.py)
    requested     may be set to "stop" or "snapshot" at any time, by a signal handler or another
                  thread; it takes effect after the current iteration, or after the current
                  batch of a test

    Functions without arguments, called in the order of their lists:

    on_step             ``step`` begins
    on_start            the gradients are cleared, and will be computed
    on_gradients_ready  the gradients are complete, and will be applied
    on_update           the weights are updated, and ``iter`` counts this iteration
    """

    net_class: type[Net] = Net  # class of the training net and the test nets

    def __init__(
        self,
        param: SolverParameter,
        source: str = "<solver>",
        seed: int | None = None,
        engine: str | None = None,
        python_layers: bool = True,
        ranks: Ranks = ALONE,
    ) -> None:
        self.param, self.source, self.ranks = solver_parameter.checked(param), source, ranks
        self.requested = None
        if seed is None:  # that of the file, else one from set_random_seed, else a random one
            seed = self.param.random_seed if self.param.random_seed >= 0 else next_seed()
        self.seed = self.ranks.everyone(secrets.randbits(31) if seed is None else seed)[0]
        self.engine = engines.get(engine)
        self.python_layers = python_layers
        self.iter = 0
        name, net = solver_parameter.train_net(self.param, source)
        self.net = self._make_net(name, net, param.train_state, phase="TRAIN", number=0)
        self.update = Update(self.param, self.net.learnable, self.engine.run)
        self.history = self.update.history
        self.smoothed = deque(maxlen=param.average_loss)
        self.test_nets = self._make_test_nets()
        for names in param.weights:
            for path in names.split(","):
                self.copy_weights(path.strip())
        self.on_step: list[Function] = []
        self.on_start: list[Function] = []
        self.on_gradients_ready: list[Function] = []
        self.on_update: list[Function] = []
        report.warn_of_no_progress(self.net, self.on_step, self.on_gradients_ready)
        self.on_step.append(self._introduce)
        # iteration and time of the last display
        self._lap: tuple[int, float] = (0, time.perf_counter())
        self.snapshots = Snapshots(self)

    # ----------------------------------------------------------------------------------------- nets

    def _make_net(
        self, name: str, param: NetParameter, state: NetState, phase: schema.Phase, number: int
    ) -> Net:
        """Build the net with this number."""
        which = (
            "training net from" if phase == "TRAIN" else f"test net (#{number - 1}) specified by"
        )
        log.info("Creating %s net file: %s", which, name)
        net = self.net_class(
            param,
            state=solver_parameter.state_of(phase, param.state, state),
            seed=self.seed + number,
            engine=self.engine.name,
            python_layers=self.python_layers,
            layer_hook=self.ranks.layer_hook if phase == "TRAIN" else None,
        )
        net.source = name
        return net

    def _make_test_nets(self) -> list[Net]:
        nets: list[Net] = []
        for i, (name, param) in enumerate(solver_parameter.test_nets(self.param, self.source)):
            state = self.param.test_state[i] if self.param.test_state else NetState()
            nets.append(self._make_net(name, param, state, phase="TEST", number=i + 1))
            nets[-1].share_params(self.net)
        return nets

    def copy_weights(self, path: str | Path) -> None:
        """Load initial weights ("finetuning"). Raises WeightsError."""
        path = find(str(path), self.source)
        log.info("Finetuning from %s", path)
        report.copied(path, *self.net.copy_from(path))

    # ------------------------------------------------------------------------------------- training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter, then take the last snapshot and test.

        Returns False if a request stopped it early.
        """
        p = self.param
        log.info("Solving %s", self.net.name)
        log.info("Learning Rate Policy: %s", p.lr_policy)
        with self.ranks.together(), self.snapshots.reserved():
            if resume is not None:
                self.restore(resume)
            finished = self._train(p.max_iter - self.iter)
            if (
                p.snapshot_after_train
                and not self._snapshot_is_due()
                and not self.snapshots.is_current()
            ):
                self.snapshot()
            if not finished:
                log.info("Optimization stopped early.")
                return False
            if self._display_is_due():
                loss = self._finite(self.net.run_forward())
                self.smoothed.append(self.ranks.agree(loss, self.requested, self.net))
                log.info("Iteration %d, loss = %.6g", self.iter, self.loss)
            if p.test_interval and self.iter % p.test_interval == 0:
                self.test_all()
        log.info("Optimization Done.")
        return True

    def _train(self, iterations: int) -> bool:
        """Like ``step``, but keeps in a snapshot the progress made before the data failed."""
        begun = self.iter
        try:
            return self.step(iterations)
        except DataError:
            if self.snapshots.are_written and self.iter > begun and not self.snapshots.is_current():
                try:
                    self.snapshot()
                except WeightsError as error:
                    log.error("%s", error)
            raise

    def step(self, iterations: int) -> bool:
        """Make some updates.

        Returns True when all are made, False if a request stopped it early.
        """
        self._lap = (self.iter, time.perf_counter())
        with self.ranks.together():
            self._call(self.on_step)
            for _ in range(iterations):
                # when the data end: a resume repeats the iteration
                with undone_after(DataError, self.nets) as undo:
                    if self.test_is_due():
                        self.test_all()
                        if self.ranks.asked(self.requested) == "stop":
                            return self._stop(undo)
                    self.net.clear_param_diffs()
                    self._call(self.on_start)
                    self.smoothed.append(self._forward_backward())
                if self._display_is_due():
                    self._display()
                self._call(self.on_gradients_ready)
                self.apply_update()
                self._call(self.on_update)
                if not self._meet_requests():
                    return self._stop()
        return True

    def _call(self, functions: list[Function]) -> None:
        for function in tuple(functions):  # which may remove themselves
            function()

    def add_callback(self, on_start: Function, on_gradients_ready: Function) -> None:
        """Call the first function before each iteration, the second when its
        gradients are ready.
        """
        self.on_start.append(on_start)
        self.on_gradients_ready.append(on_gradients_ready)

    def _introduce(self) -> None:
        """Let the ranks compare their trainings before their next step. Raises NetlibError."""
        if self.ranks.count > 1:
            self.ranks.introduce(facts_of(self.param, self.net, self.iter))
        self.on_step.remove(self._introduce)

    # ------------------------------------------------------------------------------------- requests

    def _meet_requests(self) -> bool:
        """Write a snapshot that is due or was requested. False if a stop was requested."""
        action = self.ranks.asked(self.requested)
        if action == "stop":
            return False
        if action == self.requested:
            self.requested = None
        if action == "snapshot" or self._snapshot_is_due():
            self.snapshot()
        return True

    def _stop(self, undo: Function = lambda: None) -> bool:
        """Take the snapshot of a requested stop, after ``undo``; returns False."""
        undo()
        self.requested = None
        self.snapshot()
        return False

    # -------------------------------------------------------------------------------- one iteration

    def _forward_backward(self) -> float:
        """Sum the gradients of iter_size batches and return the mean loss, both averaged
        over the ranks.
        """
        total = 0.0
        is_shown = self.param.debug_info and self._display_is_due()
        for _ in range(self.param.iter_size):
            if is_shown:
                total += self._finite(report.debug_forward(self.net))
                report.debug_backward(self.net)
            else:
                total += self._finite(self.net.run_forward_backward())
        return self.ranks.agree(total / self.param.iter_size, self.requested, self.net, self.iter)

    def _finite(self, loss: float) -> float:
        if not np.isfinite(loss):
            where = self.net.first_not_finite() or "the loss alone"
            raise DivergenceError(
                f"iteration {self.iter}: the loss is {loss}; the first value that is not finite is in {where}. "
                "Lower base_lr, set clip_gradients, or check the data; the last snapshot is untouched"
            )
        return loss

    @property
    def loss(self) -> float:
        """Mean loss of the last average_loss iterations."""
        return float(np.mean(self.smoothed)) if self.smoothed else float("nan")

    def apply_update(self) -> None:
        """Update the weights from their gradients, at the learning rate of this
        iteration, and count it.
        """
        rate = learning_rate(self.param, self.iter)
        if self.param.lr_policy == "multistep":
            before, now = (steps_taken(self.param, i) for i in (self.iter - 1, self.iter))
            if now > before:
                log.info("MultiStep Status: Iteration %d, step = %d", self.iter, now)
        if self._display_is_due():
            log.info("Iteration %d, lr = %.6g", self.iter, np.float32(rate))
        self.update.apply(rate, self.iter + 1)
        self.iter += 1

    # ----------------------------------------------------------------------------- display and test

    def _display_is_due(self) -> bool:
        return bool(self.param.display) and self.iter % self.param.display == 0

    def _display(self) -> None:
        (before, since), self._lap = self._lap, (self.iter, time.perf_counter())
        done = self.iter - before
        seconds = self._lap[1] - since
        speed = done / seconds if seconds and done else 0.0
        log.info(
            "Iteration %d (%.6g iter/s, %.6gs/%d iters), loss = %.6g",
            self.iter,
            speed,
            seconds,
            self.param.display,
            self.loss,
        )
        report.outputs("Train", self.net, mean_outputs(self.net, self.ranks))
        if self.param.debug_info:
            report.debug_params(self.net)

    def _snapshot_is_due(self) -> bool:
        return bool(self.param.snapshot) and self.iter % self.param.snapshot == 0

    def test_is_due(self) -> bool:
        """Whether the next iteration begins with tests."""
        p = self.param
        return (
            bool(p.test_interval)
            and self.iter % p.test_interval == 0
            and (self.iter > 0 or p.test_initialization)
        )

    def test_all(self) -> list[dict[str, Any]]:
        """Run the test nets until a request to stop. Returns the mean of each output, at rank 0."""
        means: list[dict[str, Any]] = []

        def test() -> None:
            means.extend(
                self.test(i) for i in range(len(self.test_nets)) if self.requested != "stop"
            )

        self.ranks.at_root(test, lambda: self.requested)
        return means

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net over test_iter batches; returns and logs the mean of each output.

        Returns {} if stopped, and for a test_iter of 0, with which scripts keep a test net for
        their own use.
        """
        net = self.test_nets[number]
        batches = self.param.test_iter[number]
        begun = time.perf_counter()
        log.info("Iteration %d, Testing net (#%d)", self.iter, number)
        found = report.means_of(
            net, f"test net (#{number})", batches, lambda: self.requested == "stop"
        )
        if found is None:
            log.info("Test interrupted.")
            return {}
        loss, means = found
        if self.param.test_compute_loss and batches:
            log.info("Test loss: %.6g", loss)
        report.outputs("Test", net, means)
        # tests do not count as training
        self._lap = (self._lap[0], self._lap[1] + time.perf_counter() - begun)
        return means

    # ------------------------------------------------------------------------------------ snapshots

    def snapshot(self) -> Path:
        """Write weights and solver state; returns the path of the state.

        Raises WeightsError, DivergenceError.
        """
        return self.snapshots.write()

    def restore(self, path: str | Path) -> None:
        """Resume from a solver state; exact to the bit if netlib wrote it. Raises WeightsError."""
        restore_state(self, path)
        self.snapshots.last = Path(path)
        self.on_step.append(self._introduce)


def get_solver(
    path: str | Path,
    seed: int | None = None,
    engine: str | None = None,
    python_layers: bool = True,
    ranks: Ranks = ALONE,
    **changes: Any,
) -> Solver:
    """Create the solver of a prototxt file; ``changes`` replace its fields (``max_iter=10``).

    Raises NetlibError.

    ``python_layers=False`` rejects nets with layers of type Python. ``ranks`` are processes that
    train together, such as ``MPIRanks(MPI.COMM_WORLD)`` (distributed/mpi.py).
    """
    return Solver(
        solver_parameter.read(path, **changes), str(path), seed, engine, python_layers, ranks
    )
