"""Training from a solver file like Caffe's command: its log in glog's format, signals as requests,
and a progress bar.

tools/train.py is the command line for this; experiments use it to train many nets.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import netlib
from netlib import engine as engines
from netlib import files
from netlib.distributed.ranks import ALONE, Ranks
from netlib.errors import NetlibError, reason_of
from netlib.files import locks
from netlib.proto import prototxt
from netlib.solver import Solver
from netlib.training import solver_parameter
from netlib.training.report import CaffeFormatter
from tools.common import outputs
from tools.common.commands import command
from tools.common.console import DONE, notify
from tools.common.progress import ProgressBar
from tools.common.ranks import ended_together, threads_of

log = logging.getLogger("netlib")

Effect = Literal["stop", "snapshot", "none"]  # of a signal


class BarHandler(logging.StreamHandler):  # type: ignore[type-arg]  # not a generic before Python 3.11
    """Writes log lines to a stream, above the progress bar if there is one.

    file  the log file, if any, which receives the same lines
    """

    bar = ProgressBar(0)
    file: LogFile | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        try:
            self.print(self.format(record))
        except Exception:
            self.handleError(record)

    def print(self, line: str) -> None:
        """Write a line, above the progress bar if there is one."""
        self.bar.print(line, self.stream)

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore that standard error cannot be written: the error could only be reported there."""


class LogFile(logging.FileHandler):
    """A log file that buffers lines until ``begin``, so that an earlier failure does not
    replace an older log.

    If writing fails later, one message reports it, and the training continues without the file.
    """

    def __init__(self, path: str | Path, append: bool) -> None:
        super().__init__(path, encoding="utf-8", delay=True)
        self._path = path
        self._append = append
        self._size: int | None = None  # of all whole lines; None for a terminal or device
        self._early: list[logging.LogRecord] = []

    def begin(self, inputs: Iterable[str | Path | None]) -> None:
        """Open the file and write the buffered lines.

        Raises NetlibError if it is one of the inputs, cannot be written, or another process
        is writing it.
        """
        outputs.refuse_inputs(self._path, inputs)
        try:
            Path(self._path).parent.mkdir(parents=True, exist_ok=True)
            self.stream = self._open()
            if Path(self._path).is_file():  # terminals and the null device are not locked
                self._take_lock(self.stream.fileno())
                if not self._append:  # only after the lock is taken
                    self.stream.truncate(0)
                self._size = os.fstat(self.stream.fileno()).st_size
        except OSError as error:
            raise NetlibError(f"{self._path}: cannot write the log: {reason_of(error)}") from error
        while self._early:
            self.emit(self._early.pop(0))

    def _take_lock(self, descriptor: int) -> None:
        """Raise NetlibError, and close the file, if another process is writing it."""
        if not locks.take(descriptor):
            self.close()
            raise NetlibError(
                f"{self._path}: another process is writing this log; wait for it, or choose "
                "another name"
            )

    def emit(self, record: logging.LogRecord) -> None:
        """Write or buffer one record."""
        if self.stream is None:
            self._early.append(record)
        else:
            super().emit(record)
            if self.stream is not None and self._size is not None:
                self._size = os.fstat(self.stream.fileno()).st_size

    def handleError(self, record: logging.LogRecord) -> None:
        """Report the error and stop writing; the file keeps its whole lines."""
        error = sys.exc_info()[1]
        self._early.clear()
        logging.getLogger(record.name).removeHandler(self)
        if self.stream is not None and self._size is not None:
            with contextlib.suppress(OSError):
                descriptor = os.dup(self.stream.fileno())
                self.close()
                os.ftruncate(descriptor, self._size)
                os.close(descriptor)
            self._size = None
        notify(f"{self.baseFilename}: cannot continue the log: {reason_of(error)}")

    def close(self) -> None:
        """Close the file; buffered data that cannot be written is lost."""
        with contextlib.suppress(OSError):
            super().close()


def train(
    solver_file: str | Path,
    *,
    snapshot: str | Path | None = None,
    weights: Sequence[str | Path] = (),
    max_iter: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    engine: str | None = None,
    log_file: str | Path | None = None,
    ranks: Ranks = ALONE,
) -> int:
    """Train to the end, or until SIGINT or SIGTERM; returns the exit status: 0, 130 or 143.

    Raises NetlibError.

    snapshot  resume from this solver state and its weights
    weights   initial weights, instead of those that the solver names
    log_file  replaced only when the first iteration begins; rejected if it is one of the inputs
    ranks     the ranks that train together; rank 0 alone logs, raises, and has an exit status, as
              that of another rank would end it too early
    """
    status = DONE
    with logged(ranks, log_file, append=snapshot is not None) as console:
        log.info("Use CPU, %s", set_up_engine(engine, ranks, threads))
        changes: dict[str, Any] = {} if max_iter is None else {"max_iter": max_iter}
        with files.noted() as read:
            solver = new_solver(solver_file, snapshot, weights, seed, engine, ranks, **changes)
        # replaced when the snapshots can be written and no other training does
        if file := console.file:
            solver.on_step.append(lambda: file.begin([snapshot, *read]))
        status = solve(solver, console, snapshot)
    if status != DONE and not ranks.rank:
        options = {
            "--max-iter": max_iter,
            "--threads": threads,
            "--engine": engine,
            "--log": log_file,
            "--ranks": ranks.count if ranks.shard.divide else None,
        }
        say_how_to_continue(solver, options)
    return DONE if ranks.rank else status


def say_how_to_continue(solver: Solver, options: Mapping[str, object]) -> None:
    """Print the command that continues a training that was stopped; options that are
    None are left out.
    """
    words: list[object] = [solver.source, "--snapshot", solver.snapshots.last]
    for option, value in options.items():
        if value is not None:
            words += [option, value]
    how = f"continue with {solver.ranks.count} ranks" if solver.ranks.count > 1 else "continue"
    notify(f"{how}: {command('train')} {shlex.join(map(str, words))}")


@contextlib.contextmanager
def logged(
    ranks: Ranks, log_file: str | Path | None = None, append: bool = False
) -> Iterator[BarHandler]:
    """Context manager: rank 0 sends netlib's log to stderr and to a file once that has begun; an
    error of one rank ends all. Raises NetlibError, on rank 0.

    append  to an existing file instead of replacing it
    """
    console = BarHandler(sys.stderr)
    handlers: list[logging.Handler] = [console]
    with ended_together(ranks), contextlib.ExitStack() as after:
        if log_file and not ranks.rank:
            console.file = LogFile(log_file, append)
            handlers.append(console.file)
            after.callback(console.file.close)
        after.callback(log.setLevel, log.level)
        after.callback(setattr, log, "propagate", log.propagate)
        log.setLevel(logging.CRITICAL if ranks.rank else logging.INFO)
        log.propagate = False
        for handler in handlers:
            handler.setFormatter(CaffeFormatter())
            log.addHandler(handler)
            after.callback(log.removeHandler, handler)
        yield console


def set_up_engine(name: str | None, ranks: Ranks, threads: int | None = None) -> str:
    """Set the number of threads, by default a rank's part of the machine; returns a
    description for the log.
    """
    chosen = engines.get(name)
    threads = threads or threads_of(ranks)
    if threads:
        chosen.set_threads(threads)
    count = chosen.threads()
    return f"{count} thread{'' if count == 1 else 's'}, engine {chosen.name}. {netlib.BLAS_NOTE}"


def new_solver(
    solver_file: str | Path,
    snapshot: str | Path | None = None,
    weights: Sequence[str | Path] = (),
    seed: int | None = None,
    engine: str | None = None,
    ranks: Ranks = ALONE,
    kind: type[Solver] = Solver,
    **changes: Any,
) -> Solver:
    """Create the solver for ``train``, of this class, and log it; ``changes`` replace fields of its
    file. Raises NetlibError.
    """
    if snapshot or weights:
        changes["weights"] = tuple(map(str, weights))
    tree = prototxt.parse_file(solver_file)
    param = solver_parameter.parameter_of(tree, **changes)  # errors come before a long text
    log.info("Initializing solver from parameters: \n%s", tree)
    solver = kind(param, str(solver_file), seed, engine, ranks=ranks)
    _describe(solver)
    if snapshot is None:
        _warn_of_zeros(solver)
    return solver


def solve(
    solver: Solver,
    console: BarHandler,
    snapshot: str | Path | None = None,
    on_sigint: Effect = "stop",
    on_sighup: Effect = "snapshot",
) -> int:
    """Train to the end, or until a signal; returns the exit status: 0, or 128 + signal.
    Raises NetlibError.
    """
    with requests_by_signal(solver, on_sigint, on_sighup) as stopped, _progress(solver, console):
        finished = solver.solve(snapshot)
    if stopped and not finished:
        return 128 + stopped[0]
    if finished or solver.ranks.count == 1:
        return DONE
    return 128 + signal.SIGTERM  # another rank received the signal


def _describe(solver: Solver) -> None:
    """Log the net and its data."""
    net = solver.net
    for at in net.connections:
        log.info("Creating Layer %s", at.layer.name)
        for name, blob in zip(at.layer.spec.top, at.top):
            where = " (in-place)" if name in at.layer.spec.bottom else ""
            log.info(
                "%s -> %s%s, top shape: %s (%d)",
                at.layer.name,
                name,
                where,
                " ".join(map(str, blob.shape)),
                blob.count,
            )
    for name in net.outputs:
        log.info("This network produces output %s", name)
    ranks = solver.ranks.count
    if ranks > 1:
        batch = next(blob.shape[0] for at in net.connections for blob in at.top)
        log.info("%d ranks × %d = %d per step; base_lr is not scaled", ranks, batch, ranks * batch)
    count = sum(param.blob.count for param in net.learnable)
    log.info("Network initialization done: %d parameters, seed %d", count, solver.seed)


def _warn_of_zeros(solver: Solver) -> None:
    """Log the layers whose weights are learned and all 0; prototxts for deployment
    often lack fillers.
    """
    learned = {id(param.blob) for param in solver.net.learnable if param.spec.lr_mult}
    for name, blobs in solver.net.params.items():
        if id(blobs[0]) in learned and blobs[0].data.ndim > 1 and not blobs[0].data.any():
            log.warning(
                "layer %r: its weights start at 0, the default without a weight_filler; expected a "
                "weight_filler, or weights for it in a file",
                name,
            )


@contextlib.contextmanager
def requests_by_signal(
    solver: Solver, on_sigint: Effect = "stop", on_sighup: Effect = "snapshot"
) -> Iterator[list[int]]:
    """Context manager: signals request a stop or a snapshot; SIGTERM always requests a stop.

    Yields a list, which receives the signal when one requests a stop. A second such signal
    ends the process.
    """
    stopped: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        solver.requested = "stop"
        stopped.append(number)
        signal.signal(number, signal.SIG_DFL)

    def snapshot(number: int, frame: FrameType | None) -> None:
        solver.requested = solver.requested or "snapshot"

    effects: dict[Effect, Any] = {"stop": stop, "snapshot": snapshot, "none": signal.SIG_IGN}
    handlers = {signal.SIGINT: effects[on_sigint], signal.SIGTERM: stop}
    if hasattr(signal, "SIGHUP"):
        handlers[signal.SIGHUP] = effects[on_sighup]
        if solver.ranks.count > 1:  # mpiexec forwards SIGUSR1, but ends at SIGHUP
            handlers[signal.SIGUSR1] = effects[on_sighup]
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield stopped
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _progress(solver: Solver, console: BarHandler) -> Iterator[None]:
    """Context manager: on a terminal, a progress bar below the log of rank 0."""
    total = 0 if solver.ranks.rank else solver.param.max_iter
    with contextlib.ExitStack() as bars:

        def begin() -> None:  # the first iteration is known only now
            console.bar = bars.enter_context(ProgressBar(total, "iter", done=solver.iter))

        def update() -> None:
            console.bar.note(f"loss {solver.loss:.4g}")
            console.bar.reach(solver.iter)

        solver.on_step.append(begin)
        solver.on_update.append(update)
        yield
