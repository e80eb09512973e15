#!/usr/bin/env python3
"""Look at data: a picture of frames of one or more data sets beside each other, with their annotated hands.

    python tools/show_data.py data/nyu/test.txt --out synthetic.png
    python tools/show_data.py data/nyu/test.txt real_crops/ --out both.png --plain

Each argument becomes a block of rows: a list of HDF5 files, an HDF5 file with depth and perhaps joint, or a folder of
crops (square 8-bit pictures of normalised depth). Frames are spread evenly over the set. Hands are drawn where there
are the model's 31 joints; --plain draws none.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.data.images import read_crop
from handpose.drawing import hands, sheets
from layers.hand import skeleton as skeletons
from netlib.errors import DataError, reason_of
from netlib.hdf5 import read_list
from tools import pictures
from tools.console import DONE, guarded, positive

Frame = tuple[NDArray[np.float32], "NDArray[np.float64] | None"]  # crop (128, 128) in [-1, 1], joints in half-cubes


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", metavar="DATA", nargs="+", help="a list, an HDF5 file, or a folder of crops")
    parser.add_argument("--out", metavar="FILE", required=True, help="the picture, .png or .jpg")
    parser.add_argument("--frames", type=positive, default=16, metavar="N", help="of each set (default: %(default)s)")
    parser.add_argument("--columns", type=positive, default=8, metavar="N", help="default: %(default)s")
    parser.add_argument("--zoom", type=positive, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument("--plain", action="store_true", help="without the annotated hands")
    args = parser.parse_args(argv)
    if not args.out.lower().endswith((".png", ".jpg")):
        parser.error(f"--out must end in .png or .jpg, found {args.out}")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Draw as the parsed arguments say."""
    skeleton = skeletons.load()
    images, titles = [], []
    for name in args.sets:
        frames = frames_of(Path(name), args.frames)
        for number, (crop, joints) in enumerate(frames):
            if args.plain or joints is None or joints.size != 3 * len(skeleton.parents):
                images.append(hands.picture(crop, args.zoom))
            else:
                images.append(hands.overlay(crop, joints, skeleton, zoom=args.zoom))
            titles.append(Path(name).name if number == 0 else "")
        while len(images) % args.columns:  # each set begins a row
            images.append(np.full_like(images[-1], 255))
            titles.append("")
    pictures.write_image(args.out, sheets.sheet(images, args.columns, titles, gap=4))
    print(f"wrote {args.out}", file=sys.stderr)
    return DONE


def frames_of(path: Path, count: int) -> list[Frame]:
    """Frames spread evenly over a data set, at most ``count``. Raises DataError."""
    if path.is_dir():
        crops = sorted(p for p in path.iterdir() if p.suffix.lower() == ".png")
        if not crops:
            raise DataError(f"{path}: no PNG pictures in this folder; expected crops")
        return [(read_crop(str(crops[i])), None) for i in _spread(len(crops), count)]
    files = [path] if path.suffix == ".h5" else read_list(str(path), None)
    try:
        rows = [(file, row) for file in files for row in range(_rows(file))]
        return [_frame(*rows[i]) for i in _spread(len(rows), count)]
    except OSError as error:
        raise DataError(f"{path}: cannot read the data: {reason_of(error)}") from None


def _spread(total: int, count: int) -> NDArray[np.int_]:
    return np.linspace(0, total - 1, min(total, count)).astype(int)


def _rows(path: Path) -> int:
    with h5py.File(path, "r") as file:
        depth = file.get("depth")
        if not isinstance(depth, h5py.Dataset) or depth.ndim < 3 or depth.shape[-1] != depth.shape[-2]:
            raise DataError(f"{path}: no data set depth of square crops; it has {', '.join(file) or 'none'}")
        return len(depth)


def _frame(path: Path, row: int) -> Frame:
    with h5py.File(path, "r") as file:
        crop = np.asarray(file["depth"][row], dtype=np.float32)
        joints = np.asarray(file["joint"][row], dtype=np.float64) if "joint" in file else None
    return crop.reshape(crop.shape[-2:]), joints


if __name__ == "__main__":
    sys.exit(main())
