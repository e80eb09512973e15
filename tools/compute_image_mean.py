#!/usr/bin/env python3
"""Compute the mean image of a database or a list of images, for transform_param { mean_file }:
Caffe's command.

    python tools/compute_image_mean.py train_lmdb mean.binaryproto
    python tools/compute_image_mean.py -resize_height=256 -resize_width=256 \\
        list.txt mean.binaryproto

INPUT is the folder of an LMDB database, as for a Data layer, or a list, as for an ImageData layer:
in each line the path of an image, to which -root_folder is prepended, a space, and its label. All
images must have the same size, unless the list's are resized. Prints the mean of each channel, for
mean_value. OUTPUT_FILE is optional. Flags have one dash or two.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from layers.data.image_data import read_list
from layers.data.images import decode_datum, planes, read_image, resize_image
from layers.data.lmdb_file import Cursor, Database
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.paths import find
from netlib.proto.binaryproto import write_blob
from tools.common import outputs
from tools.common.arguments import caffes_flags, parser_of, side
from tools.common.console import guarded, say
from tools.common.progress import ProgressBar

OF_LISTS = ("root_folder", "resize_width", "resize_height", "gray")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("input", metavar="INPUT", help="folder of a database, or a list of images")
    parser.add_argument(
        "output", metavar="OUTPUT_FILE", nargs="?", help=".binaryproto file to write, (1, C, H, W)"
    )
    parser.add_argument(
        "--backend", type=str.lower, choices=["lmdb"], default="lmdb", help="of a database"
    )
    parser.add_argument(
        "--root_folder", metavar="FOLDER/", default="", help="prepended to every path in the list"
    )
    parser.add_argument(
        "--resize_width",
        type=side,
        metavar="W",
        help="resize the images of a list to this width, px",
    )
    parser.add_argument("--resize_height", type=side, metavar="H", help="and to this height")
    parser.add_argument("--gray", action="store_true", help="read the images of a list in grey")
    args = parser.parse_args(caffes_flags(argv))
    if (args.resize_width is None) != (args.resize_height is None):
        parser.error("-resize_width and -resize_height must be given together")
    if is_database(args.input) and any(getattr(args, name) for name in OF_LISTS):
        parser.error(
            f"{', '.join(f'-{name}' for name in OF_LISTS)} apply only to a list of images, and {args.input} "
            "is a database"
        )
    return guarded(run, args)


def run(args: argparse.Namespace) -> None:
    """Compute the mean."""
    if is_database(args.input):
        inputs = [args.input, *Path(args.input).glob("*")]
        count, images = from_database(args.input)
    else:
        items, _ = read_list(Path(args.input))
        paths = [find(args.root_folder + name, args.input) for name, _ in items]
        inputs = [args.input, *paths]
        count = len(paths)
        images = from_files(paths, args)
    if args.output:
        outputs.refuse_inputs(args.output, inputs)
    total = None
    with ProgressBar(count, "images") as progress:
        for what, image in images:
            if total is None:
                total = np.zeros(image.shape)
            if image.shape != total.shape:
                raise DataError(
                    f"{what}: the image (C, H, W) is {image.shape}, the first {total.shape}; expected "
                    "equal shapes; -resize_width and -resize_height resize the images of a list"
                )
            total += image
            progress(1)
    assert total is not None  # neither an empty database nor an empty list is accepted
    mean = (total / count).astype(np.float32)
    if args.output:
        write_blob(mean[None], args.output)
    say(f"Number of channels: {len(mean)}")
    for c, channel in enumerate(mean):
        say(f"mean_value channel [{c}]: {channel.mean(dtype=np.float64):.6g}")


def is_database(path: str) -> bool:
    """Whether this is a database rather than a list."""
    return path.endswith(".mdb") or Path(path).is_dir()


def from_database(path: str) -> tuple[int, Iterator[tuple[str, Array]]]:
    """Number of entries, and their descriptions and images (C, H, W) in the order of keys.

    Raises DataError.
    """
    database = Database(Path(path))
    if not database.entries:
        raise DataError(f"{path}: the database has no entries")

    def images() -> Iterator[tuple[str, Array]]:
        cursor = Cursor(database)
        there = cursor.first()
        while there:
            what = f"{path}: entry {cursor.key.decode(errors='backslashreplace')!r}"
            yield what, decode_datum(cursor.value(), None, what)[0]
            there = cursor.next()

    return database.entries, images()


def from_files(paths: list[Path], args: argparse.Namespace) -> Iterator[tuple[str, Array]]:
    """Yield the names and images (C, H, W) of files. Raises DataError."""
    for path in paths:
        image = read_image(path, not args.gray)
        if args.resize_height:
            image = resize_image(image, args.resize_height, args.resize_width)
        yield str(path), planes(image)


if __name__ == "__main__":
    sys.exit(main())
