#!/usr/bin/env python3
"""Look at data: one picture with frames of one or more data sets and their annotated hands, or other bodies.

    python tools/show_data.py data/nyu/test.txt --out synthetic.png
    python tools/show_data.py data/nyu/test.txt real_crops/ --out both.png --plain
    python tools/show_data.py data/person/test.txt --out people.png --skeleton prototxt/body/person.prototxt

Each argument becomes a block of rows: a list of HDF5 files, an HDF5 file with depth and perhaps joint, or a folder of
crops (square 8-bit pictures of normalised depth). Frames are spread evenly over each set. Hands are drawn where a
data set has the 31 joints of the model, or as many as the --skeleton; --plain draws none.
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

from handpose.data.examples import Example, examples_of
from handpose.drawing import hands, sheets
from layers.hand import skeleton as skeletons
from netlib import files
from netlib.errors import DataError
from tools.common import outputs, pictures
from tools.common.arguments import name_in, parser_of, positive
from tools.common.console import DONE, guarded, say

LARGEST_PX = 65000  # of a JPEG, nearly
LARGEST = 1 << 28  # pixels in all, which take a GB of memory


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("sets", metavar="DATA", nargs="+", help="a list, an HDF5 file, or a folder of crops")
    parser.add_argument(
        "--out", metavar="FILE", type=name_in(".png", ".jpg"), required=True, help="the picture, .png or .jpg"
    )
    parser.add_argument("--frames", type=positive, default=16, metavar="N", help="per set (default: %(default)s)")
    parser.add_argument("--columns", type=positive, default=8, metavar="N", help="per row (default: %(default)s)")
    parser.add_argument("--zoom", type=positive, default=1, metavar="N", help="enlarge N times (default: %(default)s)")
    parser.add_argument("--skeleton", metavar="FILE", help="of the bodies (default: NYU's hand)")
    parser.add_argument("--plain", action="store_true", help="do not draw what is annotated")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Draw as the parsed arguments say."""
    skeleton = skeletons.load(args.skeleton) if args.skeleton else skeletons.load()
    with files.noted() as read:
        sets = [examples_of(Path(name), args.frames) for name in args.sets]
    beside = [path for name in args.sets for path in Path(name).glob("*")]
    outputs.refuse_inputs(args.out, [args.skeleton, *read, *beside])
    columns = min(args.columns, max(map(len, sets)))
    _refuse_large(sets, columns, args.zoom)
    images, titles = [], []
    for name, examples in zip(args.sets, sets):
        for number, (crop, joints, where) in enumerate(examples):
            found = 0 if joints is None else joints.size // 3
            if args.skeleton and found not in (0, len(skeleton.parents)):
                raise DataError(f"{name}: frames have {found} joints, "
                                f"{args.skeleton} has {len(skeleton.parents)}")  # fmt: skip
            if args.plain or joints is None or found != len(skeleton.parents):
                images.append(hands.picture(crop, args.zoom))
            elif not np.isfinite(joints).all():
                raise DataError(f"{where}: its joints are not finite; with --plain no hands are drawn")
            else:
                images.append(hands.overlay(crop, joints, skeleton, zoom=args.zoom))
            titles.append(Path(name).name if number == 0 else "")
        while len(images) % columns:  # each set begins a row
            images.append(np.full_like(images[-1], 255))
            titles.append("")
    pictures.write_image(args.out, sheets.sheet(images, columns, titles, gap=4))
    say(f"wrote {args.out}", file=sys.stderr)
    return DONE


def _refuse_large(sets: Sequence[Sequence[Example]], columns: int, zoom: int) -> None:
    """Raise DataError for what is more than a picture can be."""
    size = zoom * max(len(crop) for examples in sets for crop, *_ in examples)
    width, height = columns * size, sum(-(-len(examples) // columns) for examples in sets) * size
    if max(width, height) > LARGEST_PX or width * height > LARGEST:
        raise DataError(f"{width} x {height} pixels are more than a picture can have, {LARGEST_PX} each way and "
                        f"{LARGEST / 1e6:.0f} million in all; ask for a smaller --zoom or fewer --frames")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
