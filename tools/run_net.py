#!/usr/bin/env python3
"""Run a net on images: print its best classes or its detections, or write blobs as NumPy arrays.

    python tools/run_net.py deploy.prototxt net.caffemodel cat.jpg --mean 104,117,123 --labels synset_words.txt
    python tools/run_net.py deploy.prototxt net.caffemodel cat.jpg --mean-file mean.binaryproto
    python tools/run_net.py deploy.prototxt net.caffemodel *.jpg --scale 0.017 --blob fc7 --out features.npz
    python tools/run_net.py deploy.prototxt net.caffemodel list.txt --root-folder pictures/ --blob fc7 --out fc7.npy

An IMAGE with the suffix .txt is a list of images, as for an ImageData layer: in each line a path, a space and a label.
Each image is read in 8 bits, blue first, and resized to the net's input; then the mean is subtracted, and the result
multiplied by the scale. These are the steps and the numbers of OpenCV's blobFromImage; with a mean image, those of
Caffe's data layers: the image is resized to the mean's size, and the input is cut from its centre. Boxes of detections
are xmin ymin xmax ymax in px of the image.
"""

from __future__ import annotations

import argparse
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from layers.data.image_data import read_list
from netlib.blob import Array
from netlib.errors import NetlibError, did_you_mean
from netlib.files import atomic
from netlib.files.paths import find
from netlib.net import Net
from tools.common import outputs
from tools.common.arguments import add_engine, count, name_in, numbers, parser_of, pixels, positive_number
from tools.common.console import DONE, guarded, say
from tools.common.net_images import Preprocessing, image_input, mean_of, read_images, read_labels
from tools.common.net_results import Results
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("net", metavar="NET", help="deploy prototxt of the net")
    parser.add_argument("weights", metavar="WEIGHTS", help="*.caffemodel or *.caffemodel.h5")
    parser.add_argument("images", metavar="IMAGE", nargs="+", help="image files, or lists of them (.txt)")
    parser.add_argument("--root-folder", metavar="FOLDER/", default="", help="prepended to every path in a list")
    given = parser.add_argument_group("preprocessing (the net's author knows the values)")
    given.add_argument("--mean", type=numbers(), metavar="M[,M,M]", default=(),
                       help="to subtract: one number, or one per channel of the input (default: 0)")
    given.add_argument("--mean-file", metavar="FILE", help="mean image to subtract, .binaryproto or .npy")
    given.add_argument("--scale", type=positive_number, metavar="S", default=1.0,
                       help="factor, after the mean (default: 1)")
    given.add_argument("--rgb", action="store_true", help="the net's first channel is red (Caffe's is blue)")
    given.add_argument("--size", type=pixels, metavar="WxH", help="size of the input (default: that of the prototxt)")
    given.add_argument("--resize", type=pixels, metavar="WxH", help="resize images to this size, and cut the input "
                       "from the centre (default: size of the mean file, else of the input)")
    given.add_argument("--crop", action="store_true",
                       help="keep the aspect ratio: cut off what does not fit (default: stretch)")
    parser.add_argument("--labels", metavar="FILE", help="names of the classes, one per line")
    parser.add_argument(
        "--top", type=count, default=5, metavar="N", help="classes or detections to print (default: %(default)s)"
    )
    parser.add_argument("--blob", metavar="NAME", action="append", default=[],
                        help="blob to print or write instead of the outputs; can be repeated")
    parser.add_argument("--out", metavar="FILE", type=name_in(".npz", ".npy"), help="write the blobs of all images: "
                        ".npz, or .npy for a single one; the first axis is the image")
    parser.add_argument("--batch", type=count, metavar="N", help="images per pass (default: that of the prototxt)")
    add_engine(parser)
    args = parser.parse_args(argv)
    if args.mean and args.mean_file:
        parser.error("expected either --mean or --mean-file")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Run the net on all images. Raises NetlibError."""
    paths = _paths(args.images, args.root_folder)
    if args.out:
        outputs.check_place(Path(args.out), [args.net, args.weights, args.mean_file, args.labels, *paths])
    labels = read_labels(args.labels) if args.labels else None
    net = Net(args.net, args.weights, netlib.TEST, engine=args.engine)
    name, (batch, channels, height, width) = image_input(net)
    size = args.size or (width, height)
    mean = mean_of(args.mean, args.mean_file, channels)
    resize = args.resize or (size if mean.shape[1:] == (1, 1) else (mean.shape[2], mean.shape[1]))
    preprocessing = Preprocessing(size, resize, args.crop, args.rgb, mean, args.scale)
    blobs = args.blob or net.outputs
    if not blobs:
        raise NetlibError(f"{args.net}: no layer leaves a blob unread, so the net has no output; name one with --blob")
    if wrong := [blob for blob in blobs if blob not in net.blobs]:
        raise NetlibError(f"{args.net}: the net has no blob {wrong[0]!r}{did_you_mean(wrong[0], net.blobs)}")
    if args.out and args.out.endswith(".npy") and len(blobs) > 1:
        raise NetlibError(f"{args.out}: a .npy file holds one array, found {', '.join(blobs)}; expected .npz or --blob")
    results = [Results(net, blob, labels, args.labels) for blob in blobs]
    printed = labels or not args.out
    with ProgressBar(0 if printed else len(paths), "images") as progress:
        for some in _batches(paths, args.batch or batch):
            images = read_images(some, channels)
            inputs: dict[str, Any] = {name: preprocessing.blob(images)}
            arrays = net.forward(blobs, **inputs)
            found = [result.add(arrays[result.blob], len(some)) for result in results]
            progress(len(some))
            for number, (path, image) in enumerate(zip(some, images)):
                for result, items in zip(results, found) if printed else ():
                    first, *others = result.lines(items[number], args.top, preprocessing, image.shape)
                    say(f"{path}: {first}", *others, sep="\n")
    if args.out:
        _write(Path(args.out), {result.blob: result.array() for result in results})
    return DONE


def _paths(images: Sequence[str], root: str) -> list[str]:
    """The paths of images, with lists replaced by what they name. Raises DataError."""
    paths: list[str] = []
    for image in images:
        if image.lower().endswith(".txt"):
            paths += [str(find(root + name, image)) for name, _ in read_list(Path(image))[0]]
        else:
            paths.append(image)
    return paths


def _batches(paths: Sequence[str], size: int) -> Iterator[Sequence[str]]:
    for begin in range(0, len(paths), size):
        yield paths[begin : begin + size]


def _write(out: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays by the suffix of the file's name."""

    def fill(path: Path) -> None:
        if out.suffix.lower() == ".npy":
            with path.open("wb") as file:
                for array in arrays.values():  # only one
                    np.lib.format.write_array(file, array, allow_pickle=False)
            return
        with zipfile.ZipFile(path, "w") as archive:  # numpy.savez does not accept every name
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, array, allow_pickle=False)

    atomic.replace(out, fill)
    say(f"wrote {out}: {', '.join(f'{name} {array.shape}' for name, array in arrays.items())}")


if __name__ == "__main__":
    sys.exit(main())
