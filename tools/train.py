#!/usr/bin/env python3
"""Train a net with a solver file; logs like Caffe.

    python tools/train.py prototxt/nyu_solver.prototxt --max-iter 2000

Ctrl-C (or SIGTERM) writes a snapshot and stops; SIGHUP only writes a snapshot. To resume exactly
where the training stopped, add --snapshot snapshots/nyu_iter_2000.solverstate.h5. With --ranks,
SIGHUP ends the training; SIGUSR1 writes a snapshot.

    python tools/train.py prototxt/nyu_solver.prototxt --ranks 2

Two processes on this machine divide each batch, which for many nets is faster than two threads of
one process; with mpiexec, processes on several machines train together (docs/distributed.md).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib.errors import NetlibError
from tools.common import training
from tools.common.arguments import add_engine, count, natural, parser_of, positive
from tools.common.console import guarded
from tools.common.ranks import is_started, only_first_prints, start, world


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
        "--ranks",
        type=positive,
        default=0,
        metavar="N",
        help="start N processes that divide each batch; needs mpi4py and mpiexec",
    )
    with only_first_prints():
        args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train the net."""
    if args.ranks > 1 and not is_started():
        start(args.ranks)
    with only_first_prints():
        ranks = world(divide=args.ranks > 0)
        if args.ranks not in (0, ranks.count):
            raise NetlibError(
                f"--ranks {args.ranks}, but {ranks.count} processes were started; start this command "
                "without mpiexec, or without --ranks"
            )
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
