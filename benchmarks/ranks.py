#!/usr/bin/env python3
"""Scaling of distributed training: the paper's training step with threads and with mpiexec ranks, and a model of
clusters.

    make ranks                                  or: python benchmarks/ranks.py --steps 60

The step of one process is timed with one thread and with all, then that of ranks with one thread each, which divide the
same batch: the time of a step, and of it the time for synchronizing and averaging. From these, ``model`` estimates a
step with more ranks on other networks.

``--launch`` times two ranks on two machines that share the working directory. There gradients are averaged during the
backward pass, and in every second step after it, for comparison.

Depth images are synthetic hands. Run it on idle machines, with the extra mpi.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np
from netlib.engine.plain import BackwardHook

import netlib
from benchmarks.paper import Paper, add_batch, small
from netlib import engine
from netlib.distributed.allreduce import Buffers, Gradients
from netlib.distributed.data_parallel import DataParallel
from netlib.errors import NetlibError
from netlib.layer import Layer
from netlib.net import Net
from tools.common.arguments import parser_of, positive
from tools.common.console import DONE, aligned, guarded
from tools.common.ranks import world

RANKS = (2, 4, 8, 16, 32, 64, 128, 256)
PARTS = 3  # of the gradients of the paper's network


@dataclass(frozen=True)
class Network:
    """A network between machines.

    latency    of an empty message, in s
    bandwidth  bytes per s in each direction, simultaneously
    """

    name: str
    latency: float
    bandwidth: float


NETWORKS = (
    Network("1 Gb/s Ethernet", 50e-6, 0.117e9),
    Network("10 Gb/s Ethernet", 30e-6, 1.17e9),
    Network("100 Gb/s InfiniBand", 2e-6, 11.5e9),
)


@dataclass(frozen=True)
class Step:
    """Times of a distributed step in s, medians at rank 0.

    whole    the whole step
    behind   the rest of the backward pass after the first part of the gradients is complete
    agree    exchange of losses, requests and failures
    average  wait for the averaged gradients at the end
    """

    whole: float
    behind: float
    agree: float
    average: float


def model(network: Network, count: int, alone: Step, copies: float, size: int) -> float:
    """Estimate a step of ``count`` ranks, one per machine, in s.

    alone   the step of one rank
    copies  time to copy the gradients to the flat buffer and back, and to add them
    size    of the gradients in bytes

    Two round trips of numbers to rank 0, then each piece of the gradients to its rank and its mean to all: 2 (N - 1)
    messages for each of three parts and 2 (N - 1) / N times the bytes. All but the messages of the last part overlap
    the backward pass.
    """
    others = count - 1
    agreeing = 2 * network.latency + 2 * others * 1e-6  # rank 0 handles every message
    messages = 2 * others * network.latency
    averaging = (PARTS - 1) * messages + 2 * others / count * size / network.bandwidth
    return alone.whole + copies + agreeing + max(averaging - alone.behind, 0.0) + messages


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "--steps", type=positive, default=60, metavar="N", help="steps per timing (default: %(default)s)"
    )
    add_batch(parser)
    parser.add_argument("--launch", metavar="COMMAND", help="command that starts two ranks on two machines, to which "
                        "-n 2 is appended; time only these, each with a whole batch")
    parser.add_argument("--worker", metavar="SOLVER", help=argparse.SUPPRESS)  # for processes started by mpiexec
    parser.add_argument("--threads", type=positive, default=1, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    return guarded(worker if args.worker else run, args)


def worker(args: argparse.Namespace) -> int:
    """Time the steps of a rank; rank 0 prints those with overlapped averaging and those without."""
    ranks = world(divide=True)
    engine.get().set_threads(args.threads)
    solver = netlib.get_solver(args.worker, seed=1, callbacks=[DataParallel(ranks)])
    watch = Watch(ranks, solver.net)
    for i in range(2 * args.steps):
        watch.begin(meanwhile=i % 2 == 0)
        solver.step(1)
        watch.end()
    if ranks.rank == 0:
        steps = [dataclasses.asdict(watch.step(meanwhile)) for meanwhile in (True, False)]
        print(json.dumps([steps, sum(p.blob.bytes for p in solver.net.learnable)]))
    return DONE


class Watch:
    """Times the phases of distributed steps."""

    def __init__(self, ranks: Any, net: Net) -> None:
        self._gradients = Gradients(net.layers, net.learnable)
        self._agree = ranks.agree
        self._begin, self._finish = ranks.begin_gradients, ranks.finish_gradients
        ranks.agree, ranks.begin_gradients, ranks.finish_gradients = (
            self.agree,
            self.begin_gradients,
            self.finish_gradients,
        )
        self._start = 0.0
        self._meanwhile = True
        self._first: float | None = None
        self._times: dict[str, float] = {}
        self._steps: dict[bool, list[Step]] = {True: [], False: []}

    def begin(self, meanwhile: bool) -> None:
        """Start a step; ``meanwhile``: average gradients during the backward pass, not after it."""
        self._start, self._meanwhile, self._first, self._times = time.perf_counter(), meanwhile, None, {}

    def end(self) -> None:
        """End the step and record its times."""
        self._steps[self._meanwhile].append(Step(whole=time.perf_counter() - self._start, **self._times))

    def step(self, meanwhile: bool) -> Step:
        """Return the medians over all steps except the first fifth."""
        steps = self._steps[meanwhile]
        later = [dataclasses.astuple(step) for step in steps[len(steps) // 5 :]]
        return Step(*map(statistics.median, zip(*later)))

    def begin_gradients(self) -> BackwardHook:
        """Return the hook for the backward pass."""
        follow = self._begin() if self._meanwhile else None

        def hook(layer: Layer | None) -> None:
            if layer is not None and self._first is None and self._gradients.complete(layer):
                self._first = time.perf_counter()
            if follow is not None:
                follow(layer)

        return hook

    def agree(self, *args: Any) -> float:
        """Time the exchange after the backward pass."""
        start = time.perf_counter()
        loss: float = self._agree(*args)
        self._times.update(behind=start - (self._first or start), agree=time.perf_counter() - start)
        return loss

    def finish_gradients(self) -> None:
        """Time the wait for averaged gradients."""
        start = time.perf_counter()
        self._finish()
        self._times["average"] = time.perf_counter() - start


def run(args: argparse.Namespace) -> int:
    """Print all timings, then the model's estimates; returns the exit status."""
    cpus = engine.available_cpus()
    launch = shlex.split(args.launch) if args.launch else [_mpiexec()]
    runs = [(2, 1)] if args.launch else list(dict.fromkeys([(1, 1), (1, cpus), (cpus, 1), (2 * cpus, 1)]))
    with tempfile.TemporaryDirectory(
        dir=Path.cwd() if args.launch else None
    ) as folder:  # a folder that both machines share
        paper = Paper(Path(folder), args.batch, cpus)
        for batch in sorted({small(args.batch), args.batch}):
            frames = 2 * batch if args.launch else batch
            paper.solver(frames)
            timed = [_time(count, threads, launch, f"{folder}/solver.prototxt", args.steps) for count, threads in runs]
            (alone, _), size = timed[0]
            rows = [["processes x threads", "averaging", "step, ms", "frames/s", "exchange, ms", "averaging, ms"]]
            for (count, threads), (steps, _) in zip(runs, timed):
                for step, when in list(zip(steps, ("meanwhile", "at the end")))[0 if args.launch else 1 :]:
                    ends = [when, f"{step.agree * 1e3:.2f}", f"{step.average * 1e3:.1f}"] if count > 1 else [""] * 3
                    rows.append([f"{count} x {threads}", ends[0], f"{step.whole * 1e3:.1f}",
                                 f"{frames / step.whole:.0f}", *ends[1:]])
            print(f"\nbatch {batch}, gradients {size / 1e6:.1f} MB\n{aligned(rows)}")
            if not args.launch:
                copies = _copies(size)
                print(f"\nbatch {batch} on every rank, one rank per machine, estimated: speed, of N times one\n"
                      f"(of the {alone.whole * 1e3:.1f} ms of a step {alone.behind * 1e3:.1f} ms follow the first "
                      f"gradients; copies {copies * 1e3:.1f} ms)\n")
                print(aligned(_table(alone, copies, size)))
    return DONE


def _mpiexec() -> str:
    found = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if found is None:
        raise NetlibError("mpiexec not found; pip install mpi4py mpich")
    return found


def _time(count: int, threads: int, launch: list[str], solver: str, steps: int) -> tuple[list[Step], int]:
    """Return the steps with overlapped averaging and without, and the size of the gradients in bytes."""
    command = [sys.executable, "-m", "mpi4py", str(Path(__file__).resolve()), "--worker", solver]
    options = ["--steps", str(steps), "--threads", str(threads)]
    start = [*launch, "-n", str(count)] if count > 1 else []
    done = subprocess.run([*start, *command, *options], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NetlibError(f"{count} ranks ended with status {done.returncode}:\n{done.stderr.strip()}")
    found, size = json.loads(done.stdout)
    return [Step(**step) for step in found], size


def _copies(size: int) -> float:
    """Time copying gradients to a flat buffer and back, and adding them, in s."""
    parts = [np.ones(size // 16, np.float32) for _ in range(4)]
    buffers = Buffers(parts, 1)
    times = []
    for _ in range(9):
        start = time.perf_counter()
        for place, part in zip(buffers.places, parts):
            place[...] = part
        buffers.flat += 1
        for place, part in zip(buffers.places, parts):
            part[...] = place
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _table(alone: Step, copies: float, size: int) -> list[list[str]]:
    rows = [["network", *map(str, RANKS)]]
    for network in NETWORKS:
        speeds = [alone.whole / model(network, count, alone, copies, size) for count in RANKS]
        rows.append([network.name, *(f"{speed:.0%}" for speed in speeds)])
    return rows


if __name__ == "__main__":
    sys.exit(main())
