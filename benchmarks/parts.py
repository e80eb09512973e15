#!/usr/bin/env python3
"""Ablation of the fast engine: the time saved by each optimization in fast/.

    make parts                                  or: python benchmarks/parts.py --rounds 7

The paper's training step and forward pass are timed alternately with each optimization enabled and disabled, A B A B
..., and the median difference is printed, in ms and relative to the time with it. An optimization that saves less than
2% everywhere does not justify its code. Depth images are synthetic hands. Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tools

tools.begin(__name__)

import numpy as np

import fast.engine
import fast.inner_product
import fast.kinematics
import fast.plan
import fast.row_tiles
import fast.slices
import netlib
import netlib.updates
from benchmarks.paper import Paper, add_timing, small
from fast.engine import FAST_CLASSES, FastEngine
from fast.plan import whole
from fast.window_tiles import WindowTiles
from netlib.engine import Step
from tools.common.arguments import parser_of
from tools.common.console import DONE, guarded

Off = Callable[[], contextlib.AbstractContextManager[Any]]


def without_fast_class(place: str) -> Off:
    """Use the plain layer at this place in layers/ instead of its fast counterpart."""
    return lambda: without(FAST_CLASSES, place)


@contextlib.contextmanager
def without(table: dict[str, str], key: str) -> Iterator[None]:
    """Remove an entry from a table."""
    with mock.patch.dict(table):
        del table[key]
        yield


def patched(target: Any, name: str, value: Any) -> Off:
    """Replace a constant or function."""
    return lambda: mock.patch.object(target, name, value)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Use one thread."""
    before = netlib.threads()
    netlib.set_threads(1)
    try:
        yield
    finally:
        netlib.set_threads(before)


ELSEWHERE = ("HandAugment", "Kinematics")  # not in this network
PARTS: dict[str, Off] = {
    **{
        f"fast {name}": without_fast_class(place)
        for place in FAST_CLASSES
        if (name := place.rpartition(".")[2]) not in ELSEWHERE
    },
    "slices of the batch": patched(
        fast.engine, "plan", lambda connections, stored: [whole(at) for at in connections]
    ),
    "second thread": one_thread,
    "windows without background": patched(WindowTiles, "fits", staticmethod(lambda g, bottom, top, w: False)),
    "ReLU after the pooling": patched(fast.plan, "_pool_first", lambda row, hidden: list(row)),
    "tiles between layers": patched(fast.plan, "_agree_on_tiles", lambda order, hidden: {}),
    "products without packing": patched(fast.row_tiles, "unpacked_parts", lambda rows, inner, columns: 1),
    "small batches one item at a time": patched(fast.inner_product, "FEW_ITEMS", 0),
    "blocked products": patched(fast.inner_product, "MAX_BLOCK", 1 << 30),
    "updates in blocks": patched(netlib.updates, "BLOCK", 1 << 40),
    "updates on all threads": patched(FastEngine, "run", lambda self, jobs: [job() for job in jobs]),
    "inputs copied on all threads": patched(fast.engine, "LARGE", 1 << 40),
    "reshape only where shapes change": patched(fast.slices.WholeStep, "forward", Step.forward),
    "algorithm for single poses": patched(fast.kinematics, "FEW", 0),
}


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    parser = parser_of(__doc__)
    add_timing(parser, rounds=7, burst=0.15)
    parser.add_argument("--only", nargs="+", metavar="PART", help="only optimizations whose names contain one of these")
    args = parser.parse_args(argv)
    for word in args.only or ():
        if not any(word in part for part in PARTS):
            parser.error(f"--only {word}: matches no optimization; expected part of {', '.join(PARTS)}")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Time all selected optimizations and print a table; returns the exit status."""
    netlib.set_threads(args.threads)
    with tempfile.TemporaryDirectory() as folder:
        paper = Paper(Path(folder), args.batch, args.threads)
        batches = (args.batch, small(args.batch))
        jobs: dict[str, Callable[[], Callable[[], Any]]] = {
            **{f"step {batch}": functools.partial(step, paper, batch) for batch in batches},
            **{f"forward {batch}": functools.partial(forward, paper, batch) for batch in batches},
            "one image": functools.partial(forward, paper, 1),
        }
        print(f"{'ms saved, relative':<34}" + "".join(f"{name:>18}" for name in jobs))
        for part, off in PARTS.items():
            if args.only and not any(word in part for word in args.only):
                continue
            cells = [compare(make, off, args.rounds, args.burst) for make in jobs.values()]
            print(f"{part:<34}" + "".join(f"{cell:>18}" for cell in cells), flush=True)
    return DONE


def step(paper: Paper, batch: int) -> Callable[[], Any]:
    """Return a function that trains the paper's network for one iteration."""
    solver = paper.solver(batch)
    return lambda: solver.step(1)


def forward(paper: Paper, batch: int) -> Callable[[], Any]:
    """Return a function that runs a forward pass."""
    net = paper.deploy(batch)
    return lambda: net.forward(depth=paper.depth[:batch])


def compare(make: Callable[[], Callable[[], Any]], off: Off, rounds: int, burst: float) -> str:
    """Return the time saved, in ms and relative to the time with the optimization."""
    with_it = make()
    with off():
        without = make()
        without()
    with_it()
    calls = max(1, round(burst / seconds(with_it, 1)))
    pairs = []
    for _ in range(rounds):
        fast_time = seconds(with_it, calls)
        with off():
            pairs.append((fast_time, seconds(without, calls)))
    times = np.array(pairs)
    saved, own = float(np.median(times[:, 1] - times[:, 0])), float(np.median(times[:, 0]))
    return f"{saved * 1e3:.2f} {100 * saved / own:6.1f}%"


def seconds(job: Callable[[], Any], calls: int) -> float:
    """Return the mean time of a call in s, after one warm-up call."""
    job()
    begin = time.perf_counter()
    for _ in range(calls):
        job()
    return (time.perf_counter() - begin) / calls


if __name__ == "__main__":
    sys.exit(main())
