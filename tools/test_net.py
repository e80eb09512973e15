#!/usr/bin/env python3
"""Test a net on its own test data: the mean of each output, such as accuracy and loss, over a
number of batches.

    python tools/test_net.py train_val.prototxt net_iter_1000.caffemodel --iterations 100

The net is built for phase TEST and reads the data of its data layer. For several weights, one
block is printed for each. tools/caffe.py test is Caffe's command, which also logs the values
of each batch.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import netlib
from netlib.errors import NetlibError
from netlib.net import Net
from tools.common.arguments import add_engine, count, parser_of
from tools.common.console import guarded, notify, say
from tools.common.costs import mean_scores, warn_of_another_net


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "net", metavar="NET", help="prototxt with a data layer for phase TEST, as used for training"
    )
    parser.add_argument(
        "weights", metavar="WEIGHTS", nargs="+", help="*.caffemodel or *.caffemodel.h5"
    )
    parser.add_argument(
        "--iterations",
        type=count,
        default=50,
        metavar="N",
        help="number of batches; test_iter in a solver (default: %(default)s)",
    )
    add_engine(parser)
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Test the weights one after the other. Raises NetlibError."""
    net = Net(args.net, netlib.TEST, engine=args.engine)
    if net.inputs:
        raise NetlibError(
            f"{args.net}: the caller provides the input {net.inputs[0]!r}; expected a net that reads its "
            "test data in a data layer"
        )
    for weights in args.weights:
        _, missing = net.copy_from(weights)
        warn_of_another_net(weights, net)
        if missing:
            notify(f"{weights} has no weights for {', '.join(missing)}; they keep their values")
        loss, scores = mean_scores(net, args.iterations)
        say(f"{weights}: {args.iterations} batches, loss {loss:.6g}")
        for score in scores:
            say(f"  {score}")


if __name__ == "__main__":
    sys.exit(main())
