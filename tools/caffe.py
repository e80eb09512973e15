#!/usr/bin/env python3
"""Caffe's command: train a net, test one, time one. Flags have one dash or two; the log goes to the standard error.

    python tools/caffe.py train -solver prototxt/nyu_solver.prototxt
    python tools/caffe.py train -solver=prototxt/nyu_solver.prototxt -snapshot=snapshots/nyu_iter_2000.solverstate.h5
    python tools/caffe.py test -model prototxt/nyu_train_test.prototxt -weights snapshots/nyu_iter_2000.caffemodel.h5
    python tools/caffe.py time -model prototxt/nyu_train_test.prototxt -iterations 10

The environment says what Caffe's flags cannot: NETLIB_ENGINE=plain. docs/caffe_tools.md tells what differs from Caffe.
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

import numpy as np

import netlib
from netlib import engine, report, schema, solver_parameter
from netlib.net import Net
from tools import training
from tools.advice import on_missing_data
from tools.arguments import caffes_flags, parser_of, positive
from tools.caffe_log import BarHandler, log_to
from tools.console import DONE, guarded
from tools.costs import time_layers, time_passes

log = logging.getLogger("netlib")

NEEDED = {"train": ["solver"], "test": ["model", "weights"], "time": ["model"], "device_query": []}
EFFECTS = ("stop", "snapshot", "none")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("command", choices=NEEDED, nargs="?", help="device_query only says that this runs on the CPU")
    parser.add_argument("--solver", metavar="FILE", help="train: the solver's prototxt")
    parser.add_argument("--model", metavar="FILE", help="test, time: the net's prototxt")
    parser.add_argument("--snapshot", metavar="STATE", help="train: go on from this solver state")
    parser.add_argument("--weights", metavar="FILE", help="test: these; train: start from them, several with commas")
    parser.add_argument("--iterations", type=positive, default=50, metavar="N", help="default: %(default)s")
    parser.add_argument("--phase", choices=("TRAIN", "TEST"), default="TRAIN", help="time (default: %(default)s)")
    parser.add_argument("--level", type=int, default=0, metavar="N", help="of the net's state (default: %(default)s)")
    parser.add_argument("--stage", default="", metavar="A,B", help="of the net's state, with commas between")
    parser.add_argument("--sigint_effect", choices=EFFECTS, default="stop", help="train (default: %(default)s)")
    parser.add_argument("--sighup_effect", choices=EFFECTS, default="snapshot", help="train (default: %(default)s)")
    parser.add_argument("--gpu", metavar="ID", help="accepted; this runs on the CPU")
    args = parser.parse_args(caffes_flags(argv))
    if args.command is None:  # Caffe does the same
        parser.print_help()
        return DONE
    for flag in NEEDED[args.command]:
        if not getattr(args, flag):
            parser.error(f"{args.command} needs -{flag}")
    if args.snapshot and args.weights:
        parser.error("-snapshot brings its own weights; give either it or -weights")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Do what the parsed arguments say."""
    with log_to(None) as console:
        if args.command == "device_query":
            log.info("This runs on the CPU; there is no GPU to ask")
            return DONE
        log.info("Use CPU.")
        if args.gpu:
            log.info("-gpu %s is accepted, but this runs on the CPU", args.gpu)
        chosen = engine.get()
        log.info("%d threads, engine %s. %s", chosen.threads(), chosen.name, netlib.BLAS_NOTE)
        if args.command == "train":
            return train(args, console)
        with on_missing_data():
            phase = netlib.TRAIN if args.command == "time" and args.phase == "TRAIN" else netlib.TEST
            net = Net(args.model, phase, level=args.level, stages=stages(args))
        return time(net, args.iterations) if args.command == "time" else test(net, args.weights, args.iterations)


def stages(args: argparse.Namespace) -> tuple[str, ...]:
    """The stages between the commas."""
    return tuple(filter(None, args.stage.split(",")))


def train(args: argparse.Namespace, console: BarHandler) -> int:
    """Train; returns the exit status: Caffe's 0 for all ends that a user asks for."""
    state = solver_parameter.read(args.solver).train_state
    state = schema.changed(state, level=args.level, stage=(*state.stage, *stages(args)))
    weights = [args.weights] if args.weights else []
    solver = training.new_solver(args.solver, args.snapshot, weights, train_state=state)
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


def test(net: Net, weights: str, iterations: int) -> int:
    """Log the outputs of each batch, and their means over all."""
    report.copied(weights, *net.copy_from(weights))
    log.info("Running for %d iterations.", iterations)
    loss, sums = 0.0, {name: np.zeros(0) for name in net.outputs}
    for i in range(iterations):
        loss += net.run_forward()
        for name in net.outputs:
            values = net.blobs[name].data.ravel().astype(np.float64)
            sums[name] = sums[name] + values if i else values
            for value in values:
                log.info("Batch %d, %s = %.6g", i, name, value)
    log.info("Loss: %.6g", loss / iterations)
    for score in report.scores(net, {name: total / iterations for name, total in sums.items()}):
        log.info("%s", score)
    return DONE


def time(net: Net, iterations: int) -> int:
    """Log what each layer and whole passes cost."""
    log.info("Performing Forward")
    log.info("Initial loss: %.6g", net.run_forward())
    log.info("Performing Backward")
    net.run_backward()
    log.info("*** Benchmark begins ***")
    log.info("Testing for %d iterations.", iterations)
    passes = []
    for i in range(iterations):
        passes.append(time_passes(net, 1))
        log.info("Iteration: %d forward-backward time: %.6g ms.", i + 1, sum(passes[-1]) * 1e3)
    forward, backward = time_layers(net, iterations)
    log.info("Average time per layer: ")
    for layer in net.layers:
        log.info("%10s\tforward: %.6g ms.", layer.name, forward[layer.name] * 1e3)
        log.info("%10s\tbackward: %.6g ms.", layer.name, backward[layer.name] * 1e3)
    for what, seconds in zip(("Forward pass", "Backward pass"), np.mean(passes, axis=0)):
        log.info("Average %s: %.6g ms.", what, seconds * 1e3)
    log.info("Average Forward-Backward: %.6g ms.", np.sum(passes) / iterations * 1e3)
    log.info("Total Time: %.6g ms.", np.sum(passes) * 1e3)
    log.info("*** Benchmark ends ***")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
