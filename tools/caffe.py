#!/usr/bin/env python3
"""Train, test or time a net: Caffe's command.

Flags have one dash or two; the log goes to standard error.

    python tools/caffe.py train -solver prototxt/nyu_solver.prototxt
    python tools/caffe.py train -solver=prototxt/nyu_solver.prototxt \\
        -snapshot=snapshots/nyu_iter_2000.solverstate.h5
    python tools/caffe.py test -model prototxt/nyu_train_test.prototxt \\
        -weights snapshots/nyu_iter_2000.caffemodel.h5
    python tools/caffe.py time -model prototxt/nyu_train_test.prototxt -iterations 10

Instead of Caffe's -gpu 0,1, use mpiexec -n 2 python -m mpi4py tools/caffe.py train ...: each
process runs the batch on its own rows. Environment variables set what Caffe's flags cannot:
NETLIB_ENGINE=plain. docs/caffe_tools.md lists the differences from Caffe.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import netlib
from netlib.distributed.ranks import ALONE, Ranks
from netlib.net import Net
from netlib.proto import schema
from netlib.training import report, solver_parameter
from tools.common import training, training_log
from tools.common.arguments import MAX_COUNT, SWITCHES, caffes_flags, count, parser_of, whole
from tools.common.console import DONE, guarded
from tools.common.costs import mean_scores, report_time
from tools.common.ranks import only_first_prints, world

log = logging.getLogger("netlib")

NEEDED = {"train": ["solver"], "test": ["model", "weights"], "time": ["model"], "device_query": []}
EFFECTS = ("stop", "snapshot", "none")
GLOG = ("log_dir", "minloglevel", "stderrthreshold", "v", *SWITCHES)  # its flags


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "command", choices=NEEDED, nargs="?", help="device_query: report that this runs on the CPU"
    )
    parser.add_argument("--solver", metavar="FILE", help="train: the solver's prototxt")
    parser.add_argument("--model", metavar="FILE", help="test, time: the net's prototxt")
    start = parser.add_mutually_exclusive_group()
    start.add_argument(
        "--snapshot", metavar="STATE", help="train: resume from this solver state and its weights"
    )
    start.add_argument(
        "--weights", metavar="FILE", help="test: weights; train: initial weights, comma-separated"
    )
    parser.add_argument(
        "--iterations", type=count, default=50, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--phase", choices=("TRAIN", "TEST"), default="TRAIN", help="time (default: %(default)s)"
    )
    parser.add_argument(
        "--level",
        type=whole(-MAX_COUNT, MAX_COUNT),
        default=0,
        metavar="N",
        help="level of the net (default: %(default)s)",
    )
    parser.add_argument(
        "--stage",
        type=lambda text: tuple(filter(None, text.split(","))),
        default=(),
        metavar="A,B",
        help="stages of the net, separated by commas",
    )
    parser.add_argument(
        "--sigint_effect", choices=EFFECTS, default="stop", help="train (default: %(default)s)"
    )
    parser.add_argument(
        "--sighup_effect", choices=EFFECTS, default="snapshot", help="train (default: %(default)s)"
    )
    parser.add_argument("--gpu", metavar="ID", help="accepted; this runs on the CPU")
    parser.add_argument(
        "-v",
        *(f"--{flag}" for flag in GLOG),
        dest="glog",
        metavar="VALUE",
        help="flags of glog, ignored: the log goes to standard error",
    )
    with only_first_prints():
        args = parser.parse_args(caffes_flags(argv))
        if args.command is None:  # as in Caffe
            parser.print_help()
            return DONE
        for flag in NEEDED[args.command]:
            if not getattr(args, flag):
                parser.error(f"{args.command} needs -{flag}")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Run the command that the parsed arguments select."""
    with only_first_prints():
        ranks = world() if args.command == "train" else ALONE
    status = DONE
    with training_log.logged(ranks) as console:
        if args.glog:
            log.info("glog's flags are ignored; the log goes to standard error: 2> FILE keeps it")
        if args.command == "device_query":
            log.info("This runs on the CPU; there is no GPU to query")
            return DONE
        log.info("Use CPU.")
        if args.gpu:
            log.info("-gpu %s is accepted, but this runs on the CPU", args.gpu)
        log.info("%s", training.set_up_engine(None, ranks))
        if args.command == "train":
            status = train(args, console, ranks)
        else:
            examine(args)
    return DONE if ranks.rank else status


def train(args: argparse.Namespace, console: training_log.BarHandler, ranks: Ranks) -> int:
    """Train; returns the exit status, which is 0 for every end that the user
    requests, as in Caffe.
    """
    state = solver_parameter.read(args.solver).train_state
    state = schema.changed(state, level=args.level, stage=(*state.stage, *args.stage))
    weights = [args.weights] if args.weights else []
    solver = training.new_solver(
        args.solver, args.snapshot, weights, ranks=ranks, train_state=state
    )
    log.info("Solver scaffolding done.")
    if args.snapshot:
        log.info("Resuming from %s", args.snapshot)
        solver.restore(args.snapshot)
    log.info("Starting Optimization")
    status = training.solve(solver, console, None, args.sigint_effect, args.sighup_effect)
    if status == 128 + signal.SIGTERM:
        return status
    log.info("Optimization Done.")
    return DONE


def examine(args: argparse.Namespace) -> None:
    """Test or time a net."""
    phase = netlib.TRAIN if args.command == "time" and args.phase == "TRAIN" else netlib.TEST
    net = Net(args.model, phase, level=args.level, stages=args.stage)
    if args.command == "time":
        report_time(
            net, args.iterations, lambda *cells: log.info("\t".join(["%s"] * len(cells)), *cells)
        )
        return
    report.copied(args.weights, *net.copy_from(args.weights))
    log.info("Running for %d iterations.", args.iterations)
    loss, scores = mean_scores(
        net, args.iterations, lambda *values: log.info("Batch %d, %s = %.6g", *values)
    )
    log.info("Loss: %.6g", loss)
    for score in scores:
        log.info("%s", score)


if __name__ == "__main__":
    sys.exit(main())
