#!/usr/bin/env python3
"""Train a net as a solver file says, with Caffe's log.

    python tools/train.py prototxt/nyu_solver.prototxt --max-iter 2000

Ctrl-C (or SIGTERM) snapshots and stops; SIGHUP snapshots. Go on exactly where it stopped with
--snapshot snapshots/nyu_iter_2000.solverstate.h5
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

from netlib import engine, prototxt
from netlib.errors import DataError, NetlibError, reason_of
from netlib.solver import Solver
from tools.console import (
    DONE,
    BarHandler,
    CaffeFormatter,
    LogFile,
    duration,
    guarded,
    natural,
    positive,
    progress_bar,
)

log = logging.getLogger("netlib")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("solver", metavar="SOLVER", help="the solver's prototxt")
    parser.add_argument("--snapshot", metavar="STATE", help="go on from this solver state (*.solverstate.h5)")
    parser.add_argument("--weights", metavar="FILE", action="append", help="start from these weights (*.caffemodel.h5)")
    parser.add_argument("--max-iter", type=positive, metavar="N", help="instead of the solver's max_iter")
    parser.add_argument("--seed", type=natural, metavar="N", help="instead of the solver's random_seed")
    parser.add_argument("--threads", type=positive, metavar="N", help="threads (default: one per processor)")
    parser.add_argument("--engine", choices=engine.NAMES, help="what computes (default: fast, if it is there)")
    parser.add_argument("--log", metavar="FILE", help="write the log here as well")
    args = parser.parse_args(argv)
    if args.snapshot and args.weights:
        parser.error("--snapshot brings its own weights; give either it or --weights")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Train as the parsed arguments say."""
    with _log_to(args.log) as console:
        if args.threads:
            netlib.set_threads(args.threads)
        chosen = engine.get(args.engine)
        count = chosen.threads()
        log.info("Use CPU, %d thread%s, engine %s. %s", count, "" if count == 1 else "s", chosen.name, netlib.BLAS_NOTE)
        log.info("Initializing solver from parameters: \n%s", str(prototxt.parse_file(args.solver)).rstrip())
        changes: dict[str, Any] = {} if args.max_iter is None else {"max_iter": args.max_iter}
        if args.snapshot or args.weights:
            changes["weights"] = tuple(args.weights or ())
        with with_advice():
            solver = netlib.get_solver(args.solver, args.seed, args.engine, **changes)
        _describe(solver)
        stopped = _catch_signals(solver)
        with _Progress(solver, console):
            finished = solver.solve(args.snapshot)
        return DONE if finished or not stopped else 128 + stopped[0]


@contextlib.contextmanager
def _log_to(path: str | None) -> Iterator[BarHandler]:
    """Send the log to stderr, and to a file if one is named."""
    console = BarHandler(sys.stderr)
    handlers: list[logging.Handler] = [console]
    if path:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            handlers.append(LogFile(path, mode="w", encoding="utf-8"))
        except OSError as error:
            raise NetlibError(f"{path}: cannot write the log: {reason_of(error)}") from error
    log.setLevel(logging.INFO)
    log.propagate = False
    for handler in handlers:
        handler.setFormatter(CaffeFormatter())
        log.addHandler(handler)
    try:
        yield console
    finally:
        for handler in handlers:
            log.removeHandler(handler)
            if handler is not console:
                handler.close()


@contextlib.contextmanager
def with_advice() -> Iterator[None]:
    """Where the data of the embedded nets are missing, say how to make them."""
    try:
        yield
    except DataError as error:
        text = str(error)
        if "cannot read the list" in text and "data/nyu" in text:
            text += "; make synthetic hands with 'python tools/make_synthetic.py', or read the NYU data set with " \
                    "'python tools/prepare_nyu.py NYU_ROOT'"  # fmt: skip
        raise DataError(text) from error


def with_fields(solver: str, own: Mapping[str, object]) -> str:
    """The text of a solver, a field a line, with fields of one's own; its tests and snapshots go.

    For experiments that train many nets with one recipe.
    """
    dropped = ("test_", "snapshot", *(f"{name}:" for name in own))
    kept = [line for line in solver.splitlines() if line and not line.startswith(dropped)]
    lines = [
        f'{name}: "{value.as_posix()}"' if isinstance(value, Path) else f"{name}: {value}"
        for name, value in own.items()
    ]
    return "\n".join([*kept, *lines]) + "\n"


def _describe(solver: Solver) -> None:
    """What is trained, on what."""
    net = solver.net
    for at in net.connections:
        log.info("Creating Layer %s", at.layer.name)
        for name, blob in zip(at.layer.spec.top, at.top):
            where = " (in-place)" if name in at.layer.spec.bottom else ""
            log.info(
                "%s -> %s%s, top shape: %s (%d)", at.layer.name, name, where, " ".join(map(str, blob.shape)), blob.count
            )
        for note in getattr(at.layer, "notes", ()):
            log.info("%s: %s", at.layer.name, note)
    for name in net.outputs:
        log.info("This network produces output %s", name)
    count = sum(p.blob.count for p in net.learnable)
    log.info("Network initialization done: %d parameters, seed %d", count, solver.seed)


def _catch_signals(solver: Solver) -> list[int]:
    """Turn signals into requests; the list then holds the signal that asked to stop."""
    stopped: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        solver.requested = "stop"
        stopped.append(number)
        signal.signal(number, signal.SIG_DFL)  # a second one ends it at once

    def snapshot(number: int, frame: FrameType | None) -> None:
        solver.requested = solver.requested or "snapshot"

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, snapshot)
    return stopped


class _Progress:
    """A bar with the time left on a terminal; elsewhere a line about the time left now and then."""

    LINE_EVERY = 60.0  # seconds

    def __init__(self, solver: Solver, console: BarHandler) -> None:
        self.solver, self.console = solver, console
        self.bar: Any = None

    def __enter__(self) -> None:
        self.solver.on_iteration = self.update
        self.begun: tuple[int, float] | None = None

    def __exit__(self, *error: object) -> None:
        self.console.bar = None
        if self.bar is not None:
            self.bar.close()

    def update(self, solver: Solver) -> None:
        now = time.perf_counter()
        if self.begun is None:
            self.begun, self.said = (solver.iter, now), now
            self.bar = self.console.bar = progress_bar(solver.param.max_iter, solver.iter - 1, "iter")
        if self.bar is not None:
            self.bar.set_postfix_str(f"loss {solver.loss:.4g}", refresh=False)
            self.bar.update(solver.iter - self.bar.n)
        elif now - self.said > self.LINE_EVERY and solver.iter > self.begun[0]:
            self.said = now
            rate = (solver.iter - self.begun[0]) / (now - self.begun[1])
            log.info("%d of %d iterations done, %s left", solver.iter, solver.param.max_iter,
                     duration((solver.param.max_iter - solver.iter) / rate))  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
