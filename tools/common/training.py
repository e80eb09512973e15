"""Training from a solver file like Caffe's command: with a log (``training_log``), signals as
requests, and a progress bar.

tools/train.py is the command line for this; experiments use it to train many nets.
"""

from __future__ import annotations

import contextlib
import shlex
import signal
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import netlib
from netlib import engine as engines
from netlib import files
from netlib.distributed.ranks import ALONE, Ranks
from netlib.proto import prototxt
from netlib.solver import Solver
from netlib.training import solver_parameter
from tools.common.commands import command
from tools.common.console import DONE, notify
from tools.common.progress import ProgressBar
from tools.common.ranks import threads_of
from tools.common.training_log import BarHandler, log, logged

Effect = Literal["stop", "snapshot", "none"]  # of a signal


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
