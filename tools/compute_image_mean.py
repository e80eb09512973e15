#!/usr/bin/env python3
"""Compute the mean image of a database, for transform_param { mean_file: ... }: Caffe's compute_image_mean.

    python tools/compute_image_mean.py train_lmdb mean.binaryproto

Prints the mean of each channel, for mean_value. OUTPUT_FILE is optional.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from layers.data.images import decode_datum
from netlib.errors import DataError
from netlib.proto.binaryproto import write_blob
from tools.common import databases, outputs
from tools.common.arguments import caffes_flags, parser_of
from tools.common.console import DONE, guarded, say
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("database", metavar="INPUT_DB", help="folder of the database")
    parser.add_argument("output", metavar="OUTPUT_FILE", nargs="?", help=".binaryproto file to write, (1, C, H, W)")
    parser.add_argument("--backend", type=databases.backend, default="lmdb", help="lmdb")
    args = parser.parse_args(caffes_flags(argv))
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Compute the mean."""
    count, entries = databases.read_database(args.database)
    if args.output:
        outputs.refuse_inputs(args.output, [args.database, *Path(args.database).glob("*")])
    total = None
    with ProgressBar(count, "images") as progress:
        for what, value in entries:
            image, _ = decode_datum(value, None, what)
            if total is None:
                total = np.zeros(image.shape)
            if image.shape != total.shape:
                raise DataError(f"{what}: the image (C, H, W) is {image.shape}, the first {total.shape}; expected "
                                "equal shapes; convert_imageset.py can resize images")
            total += image
            progress(1)
    assert total is not None  # read_database rejects empty databases
    mean = (total / count).astype(np.float32)
    if args.output:
        write_blob(mean[None], args.output)
    say(f"Number of channels: {len(mean)}")
    for c, channel in enumerate(mean):
        say(f"mean_value channel [{c}]: {channel.mean(dtype=np.float64):.6g}")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
