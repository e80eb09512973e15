#!/usr/bin/env python3
"""Convert images to a database for Data layers: Caffe's convert_imageset. Flags have one dash or two.

    python tools/convert_imageset.py -resize_height=256 -resize_width=256 -shuffle pictures/ list.txt train_lmdb

LISTFILE has one line per image: its path, to which ROOTFOLDER/ is prepended, a space, and its label, an integer. Images
that cannot be read are reported and skipped. The database is written atomically.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import cv2
import numpy as np

from layers.data.image_data import read_list
from layers.data.images import decode_image, planes, read_image, resize_image
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, system_error_of
from netlib.proto.messages import Datum
from tools.common import databases
from tools.common.arguments import MAX_SIDE, caffes_flags, parser_of, whole
from tools.common.console import guarded, say
from tools.common.progress import ProgressBar

SWITCHES = ("gray", "shuffle", "check_size", "encoded")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("root", metavar="ROOTFOLDER/", help="prepended to every path in the list")
    parser.add_argument("list", metavar="LISTFILE", type=Path, help="paths and labels")
    parser.add_argument("database", metavar="DB_NAME", type=Path, help="folder to create")
    parser.add_argument("--gray", action="store_true", help="convert images to grey")
    parser.add_argument("--shuffle", action="store_true", help="shuffle the list, in the same order in every run")
    parser.add_argument("--backend", type=databases.backend, default="lmdb", help="lmdb")
    parser.add_argument("--resize_width", type=whole(0, MAX_SIDE), default=0, metavar="W",
                        help="in px; 0: do not resize")
    parser.add_argument("--resize_height", type=whole(0, MAX_SIDE), default=0, metavar="H",
                        help="in px; 0: do not resize")
    parser.add_argument("--check_size", action="store_true", help="require the same size of all images")
    parser.add_argument("--encoded", action="store_true", help="store image files instead of pixels")
    parser.add_argument(
        "--encode_type", default="", metavar="png|jpg|...", help="type of the stored files (default: their own)"
    )
    args = parser.parse_args(caffes_flags(argv, SWITCHES))
    if (args.resize_width == 0) != (args.resize_height == 0):
        parser.error("-resize_width and -resize_height must be given together")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Convert the images."""
    items, _ = read_list(args.list)
    if args.shuffle:
        items = [items[i] for i in np.random.default_rng(0).permutation(len(items))]

    def fill(writers: Sequence[databases.Writer]) -> None:
        with ProgressBar(len(items), "images") as progress:
            first = None
            for number, (name, label) in enumerate(items):
                progress(1)
                path = Path(args.root + name)
                try:
                    image = read_image(path, color=not args.gray)
                except DataError as error:
                    if system_error_of(error):
                        raise
                    progress.print(f"{error}; skipped", sys.stderr)
                    continue
                if args.resize_height:
                    image = resize_image(image, args.resize_height, args.resize_width)
                first = image.shape if first is None else first
                if args.check_size and image.shape != first:
                    raise DataError(f"{path}: the image (H, W, C) is {image.shape}, the first {first}; expected equal "
                                    "shapes because of -check_size")
                writers[0].put(f"{number:08d}_{name}", datum_of(path, image, label, args))
        if not writers[0].entries:
            raise DataError(f"{args.list}: none of its {len(items)} images can be read; ROOTFOLDER/ is prepended to "
                            f"every path, as in {args.root + items[0][0]!r}")
        if left := len(items) - writers[0].entries:
            say(f"skipped {left} of {len(items)} images", file=sys.stderr)

    return databases.write_databases([args.database], fill)


def datum_of(path: Path, image: Array, label: int, args: argparse.Namespace) -> Datum:
    """Create the entry of an image (H, W, C): its pixels, or an encoded file."""
    if args.encoded or args.encode_type:
        kind = args.encode_type or path.suffix[1:].lower()
        return Datum(data=_file_of(path, image, kind, args), label=label, encoded=True)
    H, W, C = image.shape
    return Datum(C, H, W, planes(image).tobytes(), label)


def _file_of(path: Path, image: Array, kind: str, args: argparse.Namespace) -> bytes:
    """Content of the file itself, if it has the requested type and channels; otherwise the re-encoded image."""
    own = {"jpeg": "jpg"}.get(path.suffix[1:].lower(), path.suffix[1:].lower())
    if own == {"jpeg": "jpg"}.get(kind.lower(), kind.lower()) and not args.resize_height:
        content = files.read_bytes(path, "the image")
        if not args.gray or decode_image(content, None, str(path)).shape[2] == 1:
            return content
    try:
        written, buffer = cv2.imencode(f".{kind}", image)
    except cv2.error:
        written = False
    if not written:
        raise DataError(f"{path}: OpenCV cannot encode images of type {kind!r}; expected for example -encode_type png")
    return buffer.tobytes()


if __name__ == "__main__":
    sys.exit(main())
