"""Solver: Caffe's training loop.

    solver = netlib.get_solver("solver.prototxt")
    solver.solve()                 train to the end
    solver.step(100)               or make some iterations

``iter`` always equals the number of updates made. Training logs the same lines as Caffe, to the logger "netlib";
tools/train.py adds Caffe's time stamps. Further work attaches to a solver as callbacks (training/callbacks.py).
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from netlib import engine as engines
from netlib.blob import Array
from netlib.errors import DataError, DivergenceError, LayerError, NetlibError, WeightsError
from netlib.files.paths import find
from netlib.net import Net, next_seed
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState, SolverParameter
from netlib.snapshots import hdf5_format, snapshot, weights
from netlib.training import report, solver_parameter
from netlib.training.callbacks import Callback, GradientWarning, Request, Rollback
from netlib.training.resume import extra_state, restore_state, state_of
from netlib.updates import Update, learning_rate, steps_taken

log = logging.getLogger("netlib")

SNAPSHOT_S = 120.0  # time in which a snapshot is written, also to a slow disk


class _TestStoppedError(Exception):
    """Stops a test after this batch."""


class Solver:
    """Trains a net.

    param         SolverParameter
    net           the training net
    test_nets     nets for testing; they share the parameters of ``net``
    iter          number of updates made
    update        applies gradients to the weights (updates.py); its history has, per parameter, the arrays of the rule
    smoothed      the losses of the last average_loss iterations
    callbacks     the work attached to this solver; those given, ``Rollback``, ``GradientWarning``, then those
                  that are appended
    requested     may be set to "stop" or "snapshot" at any time, by a signal handler or another thread; it takes effect
                  after the current iteration, or after the current batch of a test
    """

    net_class: type[Net] = Net  # class of the training net and the test nets

    def __init__(
        self,
        param: SolverParameter,
        source: str = "<solver>",
        seed: int | None = None,
        engine: str | None = None,
        python_layers: bool = True,
        callbacks: Sequence[Callback] = (),
    ) -> None:
        self.param, self.source = solver_parameter.checked(param), source
        self.callbacks: list[Callback] = [*callbacks, Rollback(), GradientWarning()]
        self.requested: Request | None = None
        self.seed = self._choose_seed(seed)
        self.engine = engines.get(engine)
        self.python_layers = python_layers
        self.iter = 0
        name, net = solver_parameter.train_net(self.param, source)
        self.net = self._make_net(name, net, param.train_state, phase="TRAIN", number=0)
        self.update = Update(self.param, self.net.learnable, self.engine.run)
        self.history = self.update.history
        self.smoothed: deque[float] = deque(maxlen=param.average_loss)
        self.test_nets = self._make_test_nets()
        for names in param.weights:
            for path in names.split(","):
                self.copy_weights(path.strip())
        self._lap: tuple[int, float] = (0, time.perf_counter())  # iteration and time of the last display
        self._prefixes: dict[str, Path] = {}  # snapshot_prefix -> its path at the first use
        self._saved: Path | None = None  # the last solver state written or read

    def _choose_seed(self, given: int | None) -> int:
        """The seed given, else that of the file, else one from ``set_random_seed``, else a random one."""
        if given is None:
            given = self.param.random_seed if self.param.random_seed >= 0 else next_seed()
        seed = secrets.randbits(31) if given is None else given
        for callback in self.callbacks:
            seed = callback.seed(seed)
        return seed

    @property
    def rank(self) -> int:
        """The number of this process among those that train together; 0 tests, logs and writes snapshots."""
        return max(callback.rank for callback in self.callbacks)

    @property
    def rank_count(self) -> int:
        """The number of processes that train together."""
        return max(callback.count for callback in self.callbacks)

    # ------------------------------------------------------------------------------------------ nets

    def _make_net(self, name: str, param: NetParameter, state: NetState, phase: schema.Phase, number: int) -> Net:
        """Build the net with this number."""
        which = "training net from" if phase == "TRAIN" else f"test net (#{number - 1}) specified by"
        log.info("Creating %s net file: %s", which, name)
        hooks = (callback.layer_hook for callback in self.callbacks if callback.layer_hook and phase == "TRAIN")
        net = self.net_class(
            param, state=solver_parameter.state_of(phase, param.state, state), seed=self.seed + number,
            engine=self.engine.name, python_layers=self.python_layers, layer_hook=next(hooks, None),
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

    # ------------------------------------------------------------------------------------------ training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter, then take the last snapshot and test. Returns False if a request stopped it early."""
        p = self.param
        log.info("Solving %s", self.net.name)
        log.info("Learning Rate Policy: %s", p.lr_policy)
        with self._errors(), self._snapshots_reserved():
            if resume is not None:
                self.restore(resume)
            finished = self._train(p.max_iter - self.iter)
            if p.snapshot_after_train and not (p.snapshot and self.iter % p.snapshot == 0) and not self._is_saved():
                self.snapshot()
            if not finished:
                log.info("Optimization stopped early.")
                return False
            if self._display_is_due():
                self.smoothed.append(self._last_loss())
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
            if self._writes_snapshots and self.iter > begun and not self._is_saved():
                try:
                    self.snapshot()
                except WeightsError as error:
                    log.error("%s", error)
            raise

    def step(self, iterations: int) -> bool:
        """Make some updates. Returns True when all are made, False if a request stopped it early."""
        self._lap = (self.iter, time.perf_counter())
        with self._errors():
            self._call("on_step")
            for _ in range(iterations):
                self._call("on_iteration")
                if self.test_is_due() and not self._finish_tests():
                    return self._stop()
                self.net.clear_param_diffs()
                self._call("on_start")
                self.smoothed.append(self._forward_backward())
                if self._display_is_due():
                    self._display()
                self._call("on_gradients_ready")
                self.apply_update()
                self._call("on_update")
                if not self._meet_requests():
                    return self._stop()
        return True

    # ------------------------------------------------------------------------------------------ callbacks and requests

    def _call(self, method: str) -> None:
        """Call a method of all callbacks."""
        for callback in self.callbacks:
            getattr(callback, method)(self)

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        """Context manager: the callbacks see an error before it is raised, and may replace it."""
        try:
            yield
        except NetlibError as raised:
            error = raised
            for callback in self.callbacks:
                error = callback.on_error(self, error)
            if error is raised:
                raise
            raise error from raised

    def _action(self) -> Request | None:
        """The request that takes effect now."""
        request = self.requested
        for callback in self.callbacks:
            request = callback.action(request)
        return request

    def _finish_tests(self) -> bool:
        """Run all tests. False if a stop was requested, which ends this iteration."""
        self.test_all()
        if self._action() != "stop":
            return True
        self._call("on_cut")
        return False

    def _meet_requests(self) -> bool:
        """Write a snapshot that is due or was requested. False if a stop was requested."""
        action = self._action()
        if action == "stop":
            return False
        if action == self.requested:
            self.requested = None
        if action == "snapshot" or self._snapshot_is_due():
            self.snapshot()
        return True

    def _stop(self) -> bool:
        """Take the snapshot of a requested stop; returns False."""
        self.requested = None
        self.snapshot()
        return False

    # ------------------------------------------------------------------------------------------ one iteration

    def _forward_backward(self) -> float:
        """Sum the gradients of iter_size batches and return the mean loss."""
        total = 0.0
        is_shown = self.param.debug_info and self._display_is_due()
        for _ in range(self.param.iter_size):
            total += self._finite(report.debug_forward(self.net) if is_shown else self.net.run_forward())
            if is_shown:
                report.debug_backward(self.net)
            else:
                self.net.run_backward()
        return self._agreed(total / self.param.iter_size)

    def _last_loss(self) -> float:
        """The loss of one more batch."""
        return self._agreed(self._finite(self.net.run_forward()), with_gradients=False)

    def _agreed(self, loss: float, with_gradients: bool = True) -> float:
        """The loss to report, given that of this process."""
        for callback in self.callbacks:
            loss = callback.on_loss(self, loss, with_gradients)
        return loss

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
        """Update the weights from their gradients, at the learning rate of this iteration, and count it."""
        rate = learning_rate(self.param, self.iter)
        if self.param.lr_policy == "multistep":
            before, now = (steps_taken(self.param, i) for i in (self.iter - 1, self.iter))
            if now > before:
                log.info("MultiStep Status: Iteration %d, step = %d", self.iter, now)
        if self._display_is_due():
            log.info("Iteration %d, lr = %.6g", self.iter, np.float32(rate))
        self.update.apply(rate, self.iter + 1)
        self.iter += 1

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
                 self.iter, speed, seconds, self.param.display, self.loss)
        outputs: Mapping[str, Array] = {name: self.net.blobs[name].data for name in self.net.outputs}
        for callback in self.callbacks:
            outputs = callback.outputs(self.net, outputs)
        report.outputs("Train", self.net, outputs)
        if self.param.debug_info:
            report.debug_params(self.net)

    def _snapshot_is_due(self) -> bool:
        return bool(self.param.snapshot) and self.iter % self.param.snapshot == 0

    def test_is_due(self) -> bool:
        """Whether the next iteration begins with tests."""
        p = self.param
        return bool(p.test_interval) and self.iter % p.test_interval == 0 and (self.iter > 0 or p.test_initialization)

    def _at_root(self, work: Callable[[], object], seconds: float = 0.0) -> None:
        """Do work that one process does for all."""
        for callback in reversed(self.callbacks):
            work = partial(callback.at_root, self, work, seconds)
        work()

    def test_all(self) -> list[dict[str, Any]]:
        """Run the test nets until a request to stop. Returns the mean of each output, at rank 0."""
        means: list[dict[str, Any]] = []

        def test() -> None:
            for i in range(len(self.test_nets)):
                if self.requested != "stop":
                    means.append(self.test(i))

        self._at_root(test)
        return means

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net over test_iter batches; returns and logs the mean of each output.

        Returns {} if stopped, and for a test_iter of 0, with which scripts keep a test net for their own use.
        """
        try:
            return self._test(number)
        except _TestStoppedError:
            log.info("Test interrupted.")
            return {}

    def _test(self, number: int) -> dict[str, Any]:
        net, batches = self.test_nets[number], self.param.test_iter[number]
        begun = time.perf_counter()
        log.info("Iteration %d, Testing net (#%d)", self.iter, number)
        sums: dict[str, Any] = {}
        loss = 0.0
        for _ in range(batches):
            loss += net.run_forward()
            for name in net.outputs:
                values = net.blobs[name].data.astype(np.float64).reshape(-1)
                if values.size != np.size(sums.setdefault(name, np.zeros_like(values))):
                    raise LayerError(
                        f"test net (#{number}): output {name!r} has {values.size} values in this batch, had "
                        f"{np.size(sums[name])}, so no mean exists; expected equal numbers in all batches, or a "
                        "Silence layer that reads it"
                    )
                sums[name] += values
            self._call("on_test_batch")
            if self.requested == "stop":
                raise _TestStoppedError
        if not np.isfinite(loss):
            where = net.first_not_finite() or "its loss alone"
            log.error("Test net (#%d) has a value that is not finite: %s", number, where)
        means = {name: total / batches for name, total in sums.items()}
        if self.param.test_compute_loss and batches:
            log.info("Test loss: %.6g", loss / batches)
        report.outputs("Test", net, means)
        self._lap = (self._lap[0], self._lap[1] + time.perf_counter() - begun)  # tests do not count as training
        return means

    # ------------------------------------------------------------------------------------------ snapshots

    @property
    def prefix(self) -> Path:
        """The path that snapshot names start with: snapshot_prefix, by default the solver's path without suffix.

        If it is a directory, the solver's name is appended. A directory created after the first use has no effect.
        """
        given, name = self.param.snapshot_prefix, Path(self.source).stem
        if not given:
            return Path(self.source).with_suffix("")
        if given not in self._prefixes:
            is_folder = given.endswith("/") or Path(given).is_dir()
            self._prefixes[given] = Path(given) / name if is_folder else Path(given)
        return self._prefixes[given]

    def snapshot_paths(self, iteration: int) -> tuple[Path, Path]:
        """Paths of the weights and the solver state after ``iteration`` updates."""
        stem = f"{self.prefix}_iter_{iteration}"
        suffix = ".h5" if self.param.snapshot_format == "HDF5" else ""
        return Path(f"{stem}.caffemodel{suffix}"), Path(f"{stem}.solverstate{suffix}")

    def snapshot(self) -> Path:
        """Write weights and solver state; returns the path of the state. Raises WeightsError, DivergenceError."""
        for param in self.net.learnable:
            if not np.isfinite(param.blob.data).all():
                raise DivergenceError(
                    f"iteration {self.iter}: parameter {param.index} of layer {param.layer!r} is not finite, so no "
                    "snapshot is written. Lower base_lr or set clip_gradients; the last snapshot is untouched"
                )
        weights_path, state_path = self.snapshot_paths(self.iter)
        others = [states for callback in self.callbacks for states in callback.other_states(self.net)]
        self._at_root(lambda: self._write(weights_path, state_path, others), SNAPSHOT_S)
        self._saved = state_path
        return state_path

    def _is_saved(self) -> bool:
        """Whether the last solver state written or read is that of this iteration."""
        return self._saved is not None and self._saved.absolute() == self.snapshot_paths(self.iter)[1].absolute()

    def _write(self, weights_path: Path, state_path: Path, others: Sequence[Mapping[str, Any]]) -> None:
        kind = "HDF5" if self.param.snapshot_format == "HDF5" else "binary proto"
        log.info("Snapshotting to %s file %s", kind, weights_path)
        log.info("Snapshotting solver state to %s file %s", kind, state_path)
        image = weights.image(self.net, weights_path, self.param.snapshot_diff)
        snapshot.write_pair(image, state_of(self, weights_path, others), weights_path, state_path)

    @property
    def _writes_snapshots(self) -> bool:
        return bool(self.param.snapshot or self.param.snapshot_after_train)

    @contextlib.contextmanager
    def _snapshots_reserved(self) -> Iterator[None]:
        """Context manager: no other process writes snapshots of this prefix, and this one will be able to."""
        if self.rank or not self._writes_snapshots:
            yield
            return
        with snapshot.prefix_in_use(self.prefix):
            if self.param.snapshot_format == "HDF5":
                hdf5_format.check_names(weights.owned(self.net))
            extra_state(self)  # fails now, not after hours, if the state of a layer cannot be stored
            yield

    def restore(self, path: str | Path) -> None:
        """Resume from a solver state; exact to the bit if netlib wrote it. Raises WeightsError."""
        restore_state(self, path)
        self._saved = Path(path)
        self._call("on_restore")


def get_solver(
    path: str | Path, seed: int | None = None, engine: str | None = None, python_layers: bool = True,
    callbacks: Sequence[Callback] = (), **changes: Any,
) -> Solver:
    """Create the solver of a prototxt file; ``changes`` replace its fields (``max_iter=10``). Raises NetlibError.

    ``python_layers=False`` rejects nets with layers of type Python. ``callbacks`` is work attached to the solver
    (training/callbacks.py), such as ``DataParallel(ranks)``, with which several processes train together.
    """
    return Solver(solver_parameter.read(path, **changes), str(path), seed, engine, python_layers, callbacks)
