#!/usr/bin/env python3
"""What ranks gain: the paper's training step by threads of one process and by ranks of mpiexec, and by a model beyond.

    make ranks                                  or: python benchmarks/ranks.py --steps 60

First the step of one process is timed with one thread and with all, then that of ranks with one thread each, which
divide the same batch: what a step costs, and what of it is agreeing and averaging. Then, with these figures, what a
step would cost with more ranks on other networks (``model``). Depth images are synthetic hands. Run it on a quiet
machine, with the extra mpi.
"""

from __future__ import annotations

import argparse
import json
import os
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

import netlib
from benchmarks.paper import Paper
from netlib import engine
from netlib.errors import NetlibError
from tools.arguments import parser_of, positive
from tools.console import DONE, aligned, guarded
from tools.ranks import world

BATCHES = (64, 512)
RANKS = (2, 4, 8, 16, 32, 64, 128, 256)


@dataclass(frozen=True)
class Network:
    """What connects machines.

    latency    s of a message of no length
    bandwidth  bytes per s, out of and into a machine at once
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
    """A step of some ranks in s, medians at rank 0.

    whole    all of it
    agree    telling each other losses, requests, failures
    average  summing the gradients
    """

    whole: float
    agree: float
    average: float


def model(network: Network, count: int, compute: float, copies: float, size: int) -> float:
    """A step of ``count`` ranks on machines of their own, in s.

    compute  the step of one rank alone
    copies   copying the gradients to the flat buffer and back, and adding them up
    size     of the gradients in bytes

    Two rounds of numbers to rank 0 and back; each piece of the gradients to its rank and its mean to all:
    2 (N - 1) messages and 2 (N - 1) / N times the bytes.
    """
    others = count - 1
    agreeing = 2 * network.latency + 2 * others * 1e-6  # rank 0 handles every message
    averaging = 2 * others * network.latency + 2 * others / count * size / network.bandwidth
    return compute + copies + agreeing + averaging


def main(argv: list[str] | None = None) -> int:
    """Measure; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("--steps", type=positive, default=60, metavar="N", help="of each timing (default: %(default)s)")
    parser.add_argument("--worker", metavar="SOLVER", help=argparse.SUPPRESS)  # what mpiexec starts
    parser.add_argument("--threads", type=positive, default=1, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    return guarded(worker if args.worker else run, args)


def worker(args: argparse.Namespace) -> int:
    """Time the steps of a rank; rank 0 prints them."""
    ranks = world(divide=True)
    engine.get().set_threads(args.threads)
    spent: dict[str, list[float]] = {"whole": [], "agree": [], "average": []}
    for name in ("agree", "average"):
        setattr(ranks, name, _timed(getattr(ranks, name), spent[name]))
    solver = netlib.get_solver(args.worker, seed=1, ranks=ranks)
    for _ in range(args.steps):
        begun = time.perf_counter()
        solver.step(1)
        spent["whole"].append(time.perf_counter() - begun)
    if ranks.rank == 0:
        middle = {name: statistics.median(times[len(times) // 5 :]) for name, times in spent.items()}
        middle["size"] = sum(p.blob.bytes for p in solver.net.learnable)
        print(json.dumps(middle))
    return DONE


def _timed(call: Any, times: list[float]) -> Any:
    def timed(*args: Any) -> Any:
        begun = time.perf_counter()
        result = call(*args)
        times.append(time.perf_counter() - begun)
        return result

    return timed


def run(args: argparse.Namespace) -> int:
    """All timings, then the model."""
    mpiexec = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if mpiexec is None:
        raise NetlibError("there is no mpiexec; python -m pip install 'deepmodel-numpy[mpi]'")
    cpus = engine.available_cpus()
    with tempfile.TemporaryDirectory() as folder:
        paper = Paper(Path(folder), cpus)
        for batch in BATCHES:
            paper.solver(batch)
            rows = [["processes x threads", "a step, ms", "frames/s", "agreeing, ms", "averaging, ms"]]
            single: Step | None = None
            size = 0
            for count, threads in ((1, 1), (1, cpus), (cpus, 1), (2 * cpus, 1)):
                command = [sys.executable, "-m", "mpi4py", __file__, "--worker", f"{folder}/solver.prototxt"]
                launch = [mpiexec, "-n", str(count)] if count > 1 else []
                options = ["--steps", str(args.steps), "--threads", str(threads)]
                done = subprocess.run([*launch, *command, *options], capture_output=True, text=True)
                if done.returncode:
                    raise NetlibError(f"{count} ranks: {done.stderr.strip().splitlines()[-1:]}")
                found = json.loads(done.stdout)
                size = found.pop("size")
                step = Step(**found)
                single = single or step
                rows.append([f"{count} x {threads}", f"{step.whole * 1e3:.1f}", f"{batch / step.whole:.0f}",
                             f"{step.agree * 1e3:.2f}", f"{step.average * 1e3:.1f}"])  # fmt: skip
            assert single is not None
            print(f"\nbatch {batch}, gradients {size / 1e6:.1f} MB\n{aligned(rows)}\n")
            print(f"batch {batch} on every rank, a machine each, by the model: speed, of N times one\n")
            print(aligned(_table(single.whole, _copies(size), size)))
    return DONE


def _copies(size: int) -> float:
    """Copying gradients to a flat buffer and back, and adding up as many, in s."""
    parts = [np.ones(size // 16, np.float32) for _ in range(4)]
    flat = np.zeros(size // 16 * 4, np.float32)
    times = []
    for _ in range(9):
        begun = time.perf_counter()
        for i, part in enumerate(parts):
            flat[i * part.size : (i + 1) * part.size] = part
        flat += 1
        for i, part in enumerate(parts):
            part[...] = flat[i * part.size : (i + 1) * part.size]
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def _table(compute: float, copies: float, size: int) -> list[list[str]]:
    rows = [["network", *map(str, RANKS)]]
    for network in NETWORKS:
        speeds = [compute / model(network, count, compute, copies, size) for count in RANKS]
        rows.append([network.name, *(f"{speed:.0%}" for speed in speeds)])
    return rows


if __name__ == "__main__":
    sys.exit(main())
