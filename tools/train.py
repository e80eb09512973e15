#!/usr/bin/env python3
"""Train a net as a solver file says, with Caffe's log.

    python tools/train.py prototxt/nyu_solver.prototxt --max-iter 2000

Ctrl-C (or SIGTERM) writes a snapshot and stops; SIGHUP only writes a snapshot. To go on exactly where the training
stopped, add --snapshot snapshots/nyu_iter_2000.solverstate.h5

    mpiexec -n 4 python -m mpi4py tools/train.py prototxt/nyu_solver.prototxt

Four processes train together, on one machine or several (docs/distributed.md): each runs the net's batch on its own
rows, so a step has four times as many.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from tools.common import training
from tools.common.arguments import add_engine, natural, parser_of, positive, positive_number
from tools.common.console import guarded
from tools.common.ranks import first_speaks, world


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("solver", metavar="SOLVER", help="the solver's prototxt")
    parser.add_argument("--snapshot", metavar="STATE", help="go on from this solver state (*.solverstate.h5)")
    parser.add_argument("--weights", metavar="FILE", action="append", help="start from these weights (*.caffemodel.h5)")
    parser.add_argument("--max-iter", type=positive, metavar="N", help="instead of the solver's max_iter")
    parser.add_argument(
        "--seed",
        type=natural,
        metavar="N",
        help="instead of the solver's random_seed; a snapshot of ours keeps its own random numbers",
    )
    parser.add_argument("--threads", type=positive, metavar="N", help="number of threads (default: one per processor)")
    add_engine(parser)
    parser.add_argument("--log", metavar="FILE", help="write the log to this file, too; a resumed training adds to it")
    parser.add_argument("--ranks-divide-batch", action="store_true",
                        help="several processes divide the net's batch, instead of each running all of it")  # fmt: skip
    parser.add_argument("--patience", type=positive_number, metavar="S",
                        help="wait S seconds for a process in a step (default: 20 steps, at least 10 s)")  # fmt: skip
    with first_speaks():
        args = parser.parse_args(argv)
        if args.snapshot and args.weights:
            parser.error("--snapshot brings its own weights; give either it or --weights")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train as the parsed arguments say."""
    with first_speaks():
        ranks = world(args.ranks_divide_batch, args.patience)
    return training.train(
        args.solver,
        snapshot=args.snapshot,
        weights=args.weights or (),
        max_iter=args.max_iter,
        seed=args.seed,
        threads=args.threads,
        engine=args.engine,
        log_file=args.log,
        ranks=ranks,
    )


if __name__ == "__main__":
    sys.exit(main())
