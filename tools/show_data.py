#!/usr/bin/env python3
"""Show data: one figure with frames of one or more data sets and their annotated hands
or other bodies.

    python tools/show_data.py data/nyu/test.txt --out synthetic.png
    python tools/show_data.py data/nyu/test.txt real_crops/ --out both.png --plain
    python tools/show_data.py data/person/test.txt --out people.png \\
        --skeleton prototxt/body/person.prototxt

Each argument becomes a block of rows: a list of HDF5 files, an HDF5 file with depth and optionally
joint, or a folder of crops (square 8-bit images of normalised depth). Frames are evenly spaced over
each set. Hands are drawn if a data set has the 31 joints of the model, or the joints of the
--skeleton; --plain draws none.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from handpose.datasets.frames import Example, examples_of
from handpose.output.drawing import hands, sheets, strokes
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib import files
from netlib.errors import DataError
from tools.common import outputs
from tools.common.arguments import count, name_in, parser_of
from tools.common.console import guarded, notify

COLUMNS = 8


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "sets", metavar="DATA", nargs="+", help="a list, an HDF5 file, or a folder of crops"
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=name_in(".png", ".jpg"),
        required=True,
        help="figure, .png or .jpg",
    )
    parser.add_argument(
        "--frames",
        type=count,
        default=16,
        metavar="N",
        help="frames per set (default: %(default)s)",
    )
    parser.add_argument(
        "--skeleton", metavar="FILE", help="skeleton file of the bodies (default: NYU's hand)"
    )
    parser.add_argument("--plain", action="store_true", help="do not draw annotations")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Draw the figure."""
    skeleton = skeletons.load(args.skeleton) if args.skeleton else skeletons.load()
    with files.noted() as read:
        sets = [examples_of(Path(name), args.frames) for name in args.sets]
    contents = [path for name in args.sets for path in Path(name).glob("*")]
    outputs.refuse_inputs(args.out, [args.skeleton, *read, *contents])
    columns = min(COLUMNS, max(map(len, sets)))
    images = []
    titles = []
    for name, examples in zip(args.sets, sets):
        titles.append(Path(name).name)
        images += [_picture(name, example, skeleton, args) for example in examples]
        while len(images) % columns:  # each set starts a row
            images.append(np.full_like(images[-1], 255))
        titles += [""] * (len(images) - len(titles))
    outputs.write_image(args.out, sheets.sheet(images, columns, titles, gap=4))
    notify(f"wrote {args.out}")


def _picture(
    name: str, example: Example, skeleton: Skeleton, args: argparse.Namespace
) -> strokes.Image:
    """A frame of a data set with its skeleton, if it has the joints of one, and unless --plain.

    Raises DataError for joints of another skeleton than --skeleton, and for some that are not
    finite.
    """
    crop, joints, where = example
    found = 0 if joints is None else joints.size // 3
    expected = len(skeleton.parents)
    if args.skeleton and found not in (0, expected):
        raise DataError(f"{name}: frames have {found} joints, {args.skeleton} has {expected}")
    if args.plain or joints is None or found != expected:
        return hands.picture(crop)
    if not np.isfinite(joints).all():
        raise DataError(f"{where}: its joints are not finite; use --plain to omit hands")
    return hands.overlay(crop, joints, skeleton, zoom=1)


if __name__ == "__main__":
    sys.exit(main())
