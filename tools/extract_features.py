#!/usr/bin/env python3
"""Extract blobs of a net to databases, one entry per item: Caffe's extract_features.

    python tools/extract_features.py caffenet.caffemodel features.prototxt fc6,fc7 fc6_lmdb,fc7_lmdb 10 lmdb

The net is built for phase TEST and reads its own data. Entries are Datum messages with float_data and keys 0000000000,
0000000001 ... The databases are written atomically.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from netlib.errors import NetlibError, did_you_mean
from netlib.net import Net
from netlib.proto.messages import Datum
from tools.common import databases
from tools.common.arguments import add_engine, count, parser_of
from tools.common.console import guarded, on_missing_data
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("weights", metavar="WEIGHTS", help="weights of the net")
    parser.add_argument("net", metavar="NET", help="prototxt of the net, with a data layer")
    parser.add_argument("blobs", metavar="BLOB[,BLOB]", help="names of blobs")
    parser.add_argument("databases", metavar="DB[,DB]", help="folders to create, one per blob")
    parser.add_argument("batches", metavar="NUM_BATCHES", type=count, help="number of batches to run")
    parser.add_argument("backend", metavar="lmdb", type=databases.backend, help="lmdb")
    parser.add_argument("mode", choices=("CPU", "GPU"), nargs="?", help="accepted; this runs on the CPU")
    parser.add_argument("device", metavar="DEVICE_ID", nargs="?", help="accepted")
    add_engine(parser)
    args = parser.parse_args(argv)
    args.blobs, args.databases = args.blobs.split(","), [Path(name) for name in args.databases.split(",")]
    if len(args.blobs) != len(args.databases):
        parser.error(f"{len(args.blobs)} blobs, but {len(args.databases)} databases; expected one per blob")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Extract the blobs."""
    if args.mode == "GPU":
        print("GPU is accepted, but this runs on the CPU", file=sys.stderr)
    with on_missing_data():
        net = Net(args.net, args.weights, netlib.TEST, engine=args.engine)
    for name in args.blobs:
        if name not in net.blobs:
            raise NetlibError(f"{args.net}: the net has no blob {name!r}{did_you_mean(name, net.blobs)}")
        if len(net.blobs[name].shape) > 4:
            raise NetlibError(f"{args.net}: blob {name!r} has shape {net.blobs[name].shape}; a Datum holds items "
                              "with at most three axes")

    def fill(writers: Sequence[databases.Writer]) -> None:
        with ProgressBar(args.batches, "batches") as progress:
            for _ in range(args.batches):
                tops = net.forward(blobs=args.blobs)
                for name, writer in zip(args.blobs, writers):
                    array = np.atleast_1d(tops[name])
                    C, H, W = (*array.shape[1:], 1, 1, 1)[:3]
                    for item in array:
                        values = np.ravel(item).astype(np.float32, copy=False)
                        writer.put(f"{writer.entries:010d}", Datum(C, H, W, float_data=values))
                progress(1)

    return databases.write_databases(args.databases, fill)


if __name__ == "__main__":
    sys.exit(main())
