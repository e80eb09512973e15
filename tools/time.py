#!/usr/bin/env python3
"""Time a net layer by layer, like ``caffe time``, or report its memory use.

    python tools/time.py prototxt/nyu_train_test.prototxt --iterations 20
    python tools/time.py prototxt/nyu_train_test.prototxt --engine plain

Layers are timed on one thread, as the engine runs them (fast: shard by shard, summed over a batch);
full passes run on all threads, as in training. A deploy net, with inputs and without a loss, is
timed in phase TEST. --memory lists what the net stores after one pass.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from netlib import engine
from netlib.errors import NetlibError
from netlib.layer import PHASES
from netlib.net import Net
from tools.common.arguments import add_engine, count, parser_of
from tools.common.console import guarded, say
from tools.common.costs import memory_of, report_time
from tools.common.deploy_nets import deploy_command

PHASE, DEPLOY_PHASE = "TRAIN", "TEST"


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("model", metavar="MODEL", help="prototxt of the net")
    parser.add_argument(
        "--iterations", type=count, default=20, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--phase", choices=tuple(PHASES), help=f"default: {PHASE}, of deploy nets {DEPLOY_PHASE}"
    )
    add_engine(parser, threads=True)
    parser.add_argument("--memory", action="store_true", help="report memory use instead")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Time the net."""
    if args.threads:
        engine.get(args.engine).set_threads(args.threads)
    net = _new_net(args)
    for blob in (net.blobs[name] for name in net.inputs):
        # images; other inputs, such as regions, count items
        if len(blob.shape) == 4 and blob.shape[3] > 1:
            blob.data[...] = np.random.default_rng(0).uniform(-1, 1, blob.shape)
    if args.memory:
        _print_memory(net)
    else:
        _print_times(net, args.iterations)


def _new_net(args: argparse.Namespace) -> Net:
    """Create the net that the arguments select. Raises NetlibError."""
    try:
        net = Net(args.model, PHASES[args.phase or PHASE], engine=args.engine)
    except NetlibError as error:
        deploy = deploy_command(args.model)
        if not deploy:
            raise
        raise NetlibError(
            f"{error}; without its data, time the deploy net: {deploy} writes it"
        ) from None
    if args.phase is None and net.inputs and not net.losses:
        net = Net(args.model, PHASES[DEPLOY_PHASE], engine=args.engine)
    return net


def _print_memory(net: Net) -> None:
    """Print what the net stores after a pass, and the peak of the process."""
    net.run_forward()
    net.run_backward()
    for what, size in memory_of(net):
        say(f"{size / 2**20:10.2f} MiB  {what}")
    with contextlib.suppress(ImportError):  # not available on Windows
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KiB
        say(f"{peak / 2**10:10.2f} MiB  peak of the process")


def _print_times(net: Net, iterations: int) -> None:
    """Print the times of passes, of layers, and per item of the batch."""
    batch = next(blob.shape[0] for blob in net.blobs.values() if blob.shape)
    say(f"Engine {net.engine.name}; {netlib.BLAS_NOTE}, {net.engine.threads()} threads")
    say(f"Phase {net.state.phase}, batch {batch}")
    seconds = report_time(net, iterations, lambda *cells: say(*cells, sep="\t"))
    forward, backward = (1e3 * direction / batch for direction in seconds)
    say(f"Per item of the batch of {batch}: {forward:.4g} ms forward, {backward:.4g} ms backward")


if __name__ == "__main__":
    sys.exit(main())
