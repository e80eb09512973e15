#!/usr/bin/env python3
"""Train a net with a solver file; logs like Caffe.

    python tools/train.py prototxt/nyu_solver.prototxt --max-iter 2000

Ctrl-C (or SIGTERM) writes a snapshot and stops; SIGHUP only writes a snapshot. To resume exactly
where the training stopped, add --snapshot snapshots/nyu_iter_2000.solverstate.h5

    mpiexec -n 4 python -m mpi4py tools/train.py prototxt/nyu_solver.prototxt

Four processes train together, on one machine or several (docs/distributed.md). Each runs the net's
batch on its own rows, so a step processes four times as many.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from tools.common import training
from tools.common.arguments import add_engine, count, natural, parser_of
from tools.common.console import guarded
from tools.common.ranks import only_first_prints, world


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("solver", metavar="SOLVER", help="prototxt of the solver")
    start = parser.add_mutually_exclusive_group()
    start.add_argument(
        "--snapshot",
        metavar="STATE",
        help="resume from this solver state and its weights (*.solverstate.h5)",
    )
    start.add_argument(
        "--weights",
        metavar="FILE",
        action="append",
        default=[],
        help="initial weights (*.caffemodel.h5)",
    )
    parser.add_argument(
        "--max-iter", type=count, metavar="N", help="override the solver's max_iter"
    )
    parser.add_argument(
        "--seed",
        type=natural,
        metavar="N",
        help="override the solver's random_seed; snapshots of netlib keep their random numbers",
    )
    add_engine(parser, threads=True)
    parser.add_argument(
        "--log", metavar="FILE", help="log file, in addition to stderr; a resumed training appends"
    )
    parser.add_argument(
        "--ranks-divide-batch",
        action="store_true",
        help="split the net's batch among the processes instead of running it on each",
    )
    with only_first_prints():
        args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train the net."""
    with only_first_prints():
        ranks = world(args.ranks_divide_batch)
    return training.train(
        args.solver,
        snapshot=args.snapshot,
        weights=args.weights,
        max_iter=args.max_iter,
        seed=args.seed,
        threads=args.threads,
        engine=args.engine,
        log_file=args.log,
        ranks=ranks,
    )


if __name__ == "__main__":
    sys.exit(main())
