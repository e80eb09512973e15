"""Solver: Caffe's training loop.

    solver = netlib.get_solver("solver.prototxt")
    solver.solve()                 all of it, or
    solver.step(100)               some iterations

``iter`` always equals the number of updates made. What a training prints is Caffe's log, line for line, written
to the logger "netlib"; tools/train.py gives it Caffe's time stamps.
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from netlib import engine as engines
from netlib.distributed import consistency
from netlib.distributed.gradients import Gradients
from netlib.distributed.ranks import ALONE, Ranks, latest
from netlib.distributed.share import EVERY_ROW
from netlib.errors import DataError, DivergenceError, LayerError, WeightsError
from netlib.files.paths import find
from netlib.net import Net, next_seed
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState, SolverParameter
from netlib.snapshots import hdf5_format, snapshot, weights
from netlib.training import report, solver_parameter
from netlib.training.resume import extra_state, restore_state, state_of, undo_of
from netlib.updates import RULES, Update, learning_rate, steps_taken

log = logging.getLogger("netlib")

SNAPSHOT_S = 120.0  # that other ranks wait for one to be written


class Solver:
    """Trains a net.

    param       SolverParameter
    net         the training net
    test_nets   nets for testing; they share the parameters of ``net``
    iter        number of updates made
    update      what changes the weights (updates.py); its history has, per parameter, the arrays of the update rule
    ranks       who trains together (ranks.py)
    callbacks   pairs of functions: one is called before each iteration, one when its gradients are there

    ``requested`` may be set to "stop" or "snapshot" at any time, by a signal handler or another thread: the
    iteration is finished first.
    """

    net_class: type[Net] = Net  # of all its nets

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
        latest[:] = [ranks]
        if seed is None:
            seed = param.random_seed if param.random_seed >= 0 else next_seed()
        self.seed = ranks.of_root(secrets.randbits(31) if seed is None else seed)
        self.engine = engines.get(engine)
        self.python_layers = python_layers
        self.iter = 0
        self.requested: str | None = None
        self.on_iteration: Callable[[Solver], None] | None = None
        self.callbacks: list[tuple[Callable[[], Any], Callable[[], Any]]] = []
        name, net = solver_parameter.train_net(self.param, source)
        self.net = self._make_net(name, net, param.train_state, phase="TRAIN", number=0)
        rule = {**RULES, **self.engine.rules}[self.param.type]
        self.update = Update(self.param, self.net.learnable, rule, self.engine.run)
        self.history = self.update.history
        self.smoothed: deque[float] = deque(maxlen=param.average_loss)
        self._gradients = Gradients(self.net.layers, self.net.learnable)
        self.test_nets = self._make_test_nets()
        for names in param.weights:
            for path in names.split(","):
                self.copy_weights(path.strip())
        self._introduced = False
        self._lap: tuple[int, float] = (0, time.perf_counter())
        self._prefixes: dict[str, Path] = {}  # snapshot_prefix -> what it meant when it was first used
        self._saved: Path | None = None  # the last solver state

    # ------------------------------------------------------------------------------------------ nets

    def _make_net(self, name: str, param: NetParameter, state: NetState, phase: schema.Phase, number: int) -> Net:
        which = "training net from" if phase == "TRAIN" else f"test net (#{number - 1}) specified by"
        log.info("Creating %s net file: %s", which, name)
        net = self.net_class(
            param, state=solver_parameter.state_of(phase, param.state, state), seed=self.seed + number,
            engine=self.engine.name, python_layers=self.python_layers,
            share=self.ranks.share if phase == "TRAIN" else EVERY_ROW,
        )  # fmt: skip
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
        """Start from these weights ("finetuning"). Raises WeightsError."""
        path = find(str(path), self.source)
        log.info("Finetuning from %s", path)
        report.copied(path, *self.net.copy_from(path))

    # ------------------------------------------------------------------------------------------ training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter; False if a request stopped it early. Takes the last snapshot and test."""
        p = self.param
        log.info("Solving %s", self.net.name)
        log.info("Learning Rate Policy: %s", p.lr_policy)
        with self.ranks.together(), contextlib.ExitStack() as stack:
            if (p.snapshot or p.snapshot_after_train) and self.ranks.rank == 0:
                stack.enter_context(snapshot.prefix_in_use(self.prefix))
                if p.snapshot_format == "HDF5":
                    hdf5_format.check_names(weights.owned(self.net))
                extra_state(self)  # a layer whose state cannot be stored is found now, not after hours
            return self._solve(resume)

    def _solve(self, resume: str | Path | None) -> bool:
        p = self.param
        if resume is not None:
            self.restore(resume)
        try:
            finished = self.step(p.max_iter - self.iter)
        except DataError:
            if self._introduced and (p.snapshot or p.snapshot_after_train) and not self._is_saved():
                try:
                    self.snapshot()  # what was learned is not lost with the data
                except WeightsError as error:
                    log.error("%s", error)
            raise
        if p.snapshot_after_train and not (p.snapshot and self.iter % p.snapshot == 0) and not self._is_saved():
            self.snapshot()
        if not finished:
            log.info("Optimization stopped early.")
            return False
        if p.display and self.iter % p.display == 0:
            with self.ranks.together():
                loss = self._finite(self.net.run_forward())
            self.smoothed.append(self.ranks.agree(loss, None, None))
            self.ranks.average(consistency.moving(self.net))
            log.info("Iteration %d, loss = %.6g", self.iter, self.loss)
        if p.test_interval and self.iter % p.test_interval == 0:
            self._at_root(self.test_all)
        log.info("Optimization Done.")
        return True

    def step(self, iterations: int) -> bool:
        """Make some updates; False if a request stopped it early."""
        self._introduce()
        with self.ranks.together():
            self.ranks.begin_steps(self._gradients)
        self._lap = (self.iter, time.perf_counter())
        for _ in range(iterations):
            self.net.clear_param_diffs()
            test = self._test_is_due()
            with _undone_if_cut_short([self.net, *self.test_nets] if test else [self.net]) as undo:
                if test and self._at_root(self.test_all) == "stop":
                    undo()  # a resume makes the tests of this iteration again, from the same rows on
                    return self._stop()
                for on_start, _ in self.callbacks:
                    on_start()
                checksum = consistency.checksum(self)
                with self.ranks.together():
                    loss = self._forward_backward()
                self.smoothed.append(self.ranks.agree(loss, self.requested, checksum))
            self.ranks.finish_gradients()
            self.ranks.average(consistency.moving(self.net))
            if self._display_is_due():
                self._display()
            for _, on_gradients_ready in self.callbacks:
                on_gradients_ready()
            self.apply_update()
            self.iter += 1
            if self.on_iteration is not None:
                self.on_iteration(self)
            asked = self.ranks.asked(self.requested)
            if asked == "stop":
                return self._stop()
            if self.requested == asked:
                self.requested = None
            if asked == "snapshot" or (self.param.snapshot and self.iter % self.param.snapshot == 0):
                self.snapshot()
        return True

    def _stop(self) -> bool:
        self.requested = None
        self.snapshot()
        return False

    # ------------------------------------------------------------------------------------------ several ranks

    def _introduce(self) -> None:
        """Ranks that train together must be about to compute the same, each on its own rows. Raises NetlibError."""
        if not self._introduced and self.ranks.count > 1:
            with self.ranks.together():
                facts = consistency.facts_of(self)
            self.ranks.introduce(facts)
        self._introduced = True

    def _at_root(self, do: Callable[[], Any]) -> str | None:
        """Rank 0 does it while the others wait; what rank 0 was asked for by then. Raises what ``do`` raises."""
        with self.ranks.together():
            if self.ranks.rank == 0:
                do()
        return self.ranks.from_root(self.requested)

    # ------------------------------------------------------------------------------------------ one iteration

    def _forward_backward(self) -> float:
        """Sum the gradients of iter_size batches; returns the mean loss."""
        total = 0.0
        is_shown = self.param.debug_info and self._display_is_due()
        for left in reversed(range(self.param.iter_size)):
            loss = self.net.run_forward(report.debug_forward) if is_shown else self.net.run_forward()
            total += self._finite(loss)
            self.net.run_backward(
                None if left else self.ranks.begin_gradients(), report.debug_backward if is_shown else None
            )
        return total / self.param.iter_size

    def _finite(self, loss: float) -> float:
        if not np.isfinite(loss):
            where = self.net.first_not_finite() or "the loss alone"
            raise DivergenceError(
                f"iteration {self.iter}: the loss is {loss}; the first value that is not finite is in {where}. "
                "Lower base_lr, set clip_gradients, or look at the data; the last snapshot is untouched"
            )
        return loss

    @property
    def loss(self) -> float:
        """The mean loss of the last average_loss iterations."""
        return float(np.mean(self.smoothed)) if self.smoothed else float("nan")

    def apply_update(self) -> None:
        """Change the weights by the gradients, at the rate of this iteration."""
        rate = learning_rate(self.param, self.iter)
        if self.param.lr_policy == "multistep":
            before, now = (steps_taken(self.param, i) for i in (self.iter - 1, self.iter))
            if now > before:
                log.info("MultiStep Status: Iteration %d, step = %d", self.iter, now)
        if self._display_is_due():
            log.info("Iteration %d, lr = %.6g", self.iter, np.float32(rate))
        self.update.apply(rate, self.iter + 1)

    # ------------------------------------------------------------------------------------------ display and test

    def _display_is_due(self) -> bool:
        return bool(self.param.display) and self.iter % self.param.display == 0

    def _display(self) -> None:
        before, since = self._lap
        now = time.perf_counter()
        self._lap = (self.iter, now)
        done, seconds = self.iter - before, now - since
        speed = done / seconds if seconds and done else 0.0
        log.info("Iteration %d (%.6g iter/s, %.6gs/%d iters), loss = %.6g",
                 self.iter, speed, seconds, self.param.display, self.loss)  # fmt: skip
        report.outputs("Train", self.net, consistency.mean_outputs(self.net, self.ranks))
        if self.param.debug_info:
            report.debug_params(self.net)

    def _test_is_due(self) -> bool:
        p = self.param
        return bool(p.test_interval) and self.iter % p.test_interval == 0 and (self.iter > 0 or p.test_initialization)

    def test_all(self) -> list[dict[str, Any]]:
        """Test every test net; returns the mean of each output."""
        means = []
        for i in range(len(self.test_nets)):
            if self.requested == "stop":
                break
            means.append(self.test(i))
        return means

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net over test_iter batches; returns and logs the mean of each output."""
        net, batches = self.test_nets[number], self.param.test_iter[number]
        begun = time.perf_counter()
        log.info("Iteration %d, Testing net (#%d)", self.iter, number)
        sums: dict[str, Any] = {}
        loss = 0.0
        for _ in range(batches):
            loss += net.run_forward()
            self.ranks.alive()
            for name in net.outputs:
                values = net.blobs[name].data.astype(np.float64).reshape(-1)
                if values.size != np.size(sums.setdefault(name, np.zeros_like(values))):
                    raise LayerError(
                        f"test net (#{number}): output {name!r} has {values.size} values in this batch, had "
                        f"{np.size(sums[name])}, so they have no mean; expected as many in all, or a Silence layer "
                        "that reads it"
                    )
                sums[name] += values
            if self.requested == "stop":
                log.info("Test interrupted.")
                return {}
        if not np.isfinite(loss):
            where = net.first_not_finite() or "its loss alone"
            log.error("Test net (#%d) has a value that is not finite: %s", number, where)
        means = {name: total / batches for name, total in sums.items()}
        if self.param.test_compute_loss:
            log.info("Test loss: %.6g", loss / batches)
        report.outputs("Test", net, means)
        self._lap = (self._lap[0], self._lap[1] + time.perf_counter() - begun)  # tests do not count as training
        return means

    # ------------------------------------------------------------------------------------------ snapshots

    @property
    def prefix(self) -> Path:
        """snapshot_prefix. A directory gets the solver's name appended; if empty, the solver's path without suffix.

        A directory that comes to be later changes nothing.
        """
        given, name = self.param.snapshot_prefix, Path(self.source).stem
        if not given:
            return Path(self.source).with_suffix("")
        if given not in self._prefixes:
            is_folder = given.endswith("/") or Path(given).is_dir()
            self._prefixes[given] = Path(given) / name if is_folder else Path(given)
        return self._prefixes[given]

    def snapshot_paths(self, iteration: int) -> tuple[Path, Path]:
        """Where the weights and the solver state after ``iteration`` updates go."""
        stem = f"{self.prefix}_iter_{iteration}"
        suffix = ".h5" if self.param.snapshot_format == "HDF5" else ""
        return Path(f"{stem}.caffemodel{suffix}"), Path(f"{stem}.solverstate{suffix}")

    def snapshot(self) -> Path:
        """Write weights and solver state; returns the path of the state. Of several ranks all must be here, rank 0
        writes. Raises WeightsError."""
        for param in self.net.learnable:
            if not np.isfinite(param.blob.data).all():
                raise DivergenceError(
                    f"iteration {self.iter}: parameter {param.index} of layer {param.layer!r} is not finite, so no "
                    "snapshot is written. Lower base_lr or set clip_gradients; the last snapshot is untouched"
                )
        weights_path, state_path = self.snapshot_paths(self.iter)
        others = self.ranks.gather(snapshot.as_plain(self.net.layer_states()) if self.ranks.count > 1 else {})
        self._at_root(lambda: self._write(weights_path, state_path, others))
        self._saved = state_path
        return state_path

    def _is_saved(self) -> bool:
        """Is the last solver state that was written or read the one of this iteration?"""
        return self._saved is not None and self._saved.absolute() == self.snapshot_paths(self.iter)[1].absolute()

    def _write(self, weights_path: Path, state_path: Path, others: Sequence[Mapping[str, Any]]) -> None:
        kind = "HDF5" if self.param.snapshot_format == "HDF5" else "binary proto"
        log.info("Snapshotting to %s file %s", kind, weights_path)
        log.info("Snapshotting solver state to %s file %s", kind, state_path)
        self.ranks.alive(SNAPSHOT_S)
        image = weights.image(self.net, weights_path, self.param.snapshot_diff)
        snapshot.write_pair(image, state_of(self, weights_path, others), weights_path, state_path)

    def restore(self, path: str | Path) -> None:
        """Go on from a solver state, bit for bit if this project wrote it. Raises WeightsError."""
        restore_state(self, path)
        self._saved = Path(path)
        self._introduced = False


@contextlib.contextmanager
def _undone_if_cut_short(nets: Sequence[Net]) -> Iterator[Callable[[], None]]:
    """What fails within it for want of data leaves data positions and random numbers as they were: an iteration is
    made whole or not at all. Yields a function that puts them back."""
    undo = undo_of(nets)
    try:
        yield undo
    except DataError:
        undo()
        raise


def get_solver(
    path: str | Path, seed: int | None = None, engine: str | None = None, python_layers: bool = True,
    ranks: Ranks = ALONE, **changes: Any,
) -> Solver:  # fmt: skip
    """The solver of a prototxt file; ``changes`` replace its fields (``max_iter=10``). Raises NetlibError.

    ``python_layers=False`` refuses nets that bring code of their own; ``ranks`` train together (``mpi.MPIRanks``).
    """
    return Solver(solver_parameter.read(path, **changes), str(path), seed, engine, python_layers, ranks)
