#!/usr/bin/env python3
"""Run a net on images: print its best classes or its detections, or write blobs as NumPy arrays.

    python tools/run_net.py deploy.prototxt net.caffemodel cat.jpg \\
        --mean 104,117,123 --labels synset_words.txt
    python tools/run_net.py deploy.prototxt net.caffemodel cat.jpg --mean-file mean.binaryproto
    python tools/run_net.py deploy.prototxt net.caffemodel *.jpg \\
        --scale 0.017 --blob fc7 --out features.npz
    python tools/run_net.py deploy.prototxt net.caffemodel pictures/ \\
        --labels synset_words.txt --top 1
    python tools/run_net.py deploy.prototxt net.caffemodel list.txt \\
        --root-folder pictures/ --blob fc7 --out fc7.npy
    python tools/run_net.py ssd.prototxt ssd.caffemodel street.jpg \\
        --labels map.prototxt --threshold 0.5 --draw out.jpg

An IMAGE with the suffix .txt is a list of images, as for an ImageData layer: in each line a path, a
space and a label. A folder stands for the pictures in it, in the order of the numbers in their
names. Each image is read in 8 bits, blue first, and resized to the net's input; then the mean is
subtracted, and the result multiplied by the scale. These are the steps and the numbers of OpenCV's
blobFromImage; with a mean image, those of Caffe's data layers: the image is resized to the mean's
size, and the input is cut from its centre. Boxes of detections are xmin ymin xmax ymax in px of the
image. --confusion compares the classes with the labels of a list.
"""

from __future__ import annotations

import argparse
import sys
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from layers.data.image_data import read_list
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, did_you_mean
from netlib.files import atomic
from netlib.files.paths import find
from netlib.net import Net
from tools.common import outputs
from tools.common.arguments import add_engine, count, name_in, parser_of, pixels, real
from tools.common.console import guarded, say
from tools.common.deploy_nets import refuse_training_net
from tools.common.net_images import (
    PICTURES,
    Pass,
    add_value_options,
    passes,
    pictures_in,
    preprocessing_of,
    read_labels,
)
from tools.common.net_results import Confusion, Results, Shown
from tools.common.progress import ProgressBar

TOP = 5  # classes or detections to show


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("net", metavar="NET", help="deploy prototxt of the net")
    parser.add_argument("weights", metavar="WEIGHTS", help="*.caffemodel or *.caffemodel.h5")
    parser.add_argument(
        "images", metavar="IMAGE", nargs="+", help="image files, folders of them, or lists (.txt)"
    )
    parser.add_argument(
        "--root-folder", metavar="FOLDER/", default="", help="prepended to every path in a list"
    )
    _add_preprocessing_options(parser)
    _add_output_options(parser)
    parser.add_argument(
        "--batch", type=count, metavar="N", help="images per pass (default: that of the prototxt)"
    )
    add_engine(parser)
    return guarded(run, parser.parse_args(argv))


def _add_preprocessing_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for how images become the net's input."""
    given = parser.add_argument_group("preprocessing (the net's author knows the values)")
    add_value_options(given, 1.0)
    given.add_argument(
        "--size",
        type=pixels,
        metavar="WxH",
        help="size of the input (default: that of the prototxt)",
    )
    given.add_argument(
        "--resize",
        type=pixels,
        metavar="WxH",
        help="resize images to this size, and cut the input "
        "from the centre (default: size of the mean file, else of the input)",
    )
    given.add_argument(
        "--crop",
        action="store_true",
        help="keep the aspect ratio: cut off what does not fit (default: stretch)",
    )


def _add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for what is printed, drawn and written."""
    parser.add_argument(
        "--labels", metavar="FILE", help="names of the classes, one per line, or a LabelMap of SSD"
    )
    parser.add_argument(
        "--top",
        type=count,
        metavar="N",
        help=f"classes or detections to show (default: {TOP}, with --threshold all)",
    )
    parser.add_argument(
        "--threshold", type=real(0, 1), metavar="P", help="least confidence to show, from 0 to 1"
    )
    parser.add_argument(
        "--draw",
        metavar="FILE|FOLDER",
        type=Path,
        help="draw the detections: a .jpg or .png of one image, or a folder for those of all",
    )
    parser.add_argument(
        "--confusion",
        action="store_true",
        help="print how often images of each class in the lists are taken for another, not each image",
    )
    parser.add_argument(
        "--blob",
        metavar="NAME",
        action="append",
        default=[],
        help="blob to print or write instead of the outputs; can be repeated",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=name_in(".npz", ".npy"),
        help="write the blobs of all images: "
        ".npz, or .npy for a single one; the first axis is the image",
    )


def run(args: argparse.Namespace) -> None:
    """Run the net on all images. Raises NetlibError."""
    paths, truth = _paths(args.images, args.root_folder)
    if args.out:
        outputs.check_place(args.out, [args.net, args.weights, args.mean_file, args.labels, *paths])
    labels = read_labels(args.labels) if args.labels else None
    refuse_training_net(args.net)
    net = Net(args.net, args.weights, netlib.TEST, engine=args.engine)
    preprocessing = preprocessing_of(net, args, args.size, args.resize, args.crop)
    blobs = _blobs(net, args)
    shown = _shown(args)
    results = [Results(net, blob, labels, args.labels, shown, preprocessing) for blob in blobs]
    places = _pictures(args.draw, paths, results) if args.draw else []
    confusion = _confusion(blobs, labels, truth) if args.confusion else None
    printed = results if not args.confusion and (labels or not args.out) else []
    each_pass = passes(net, paths, preprocessing, blobs, args.batch)
    with ProgressBar(0 if printed else len(paths), "images") as progress:
        for number, (path, image, values) in enumerate(_images(each_pass, results)):
            for result, of_blob in zip(printed, values):
                _print(path, result.lines(of_blob, image.shape))
            if places:
                outputs.write_image(places[number], results[0].drawn(values[0], image))
            if confusion:
                results[0].check_labels(values[0].size)
                confusion.add(path, truth[number], values[0])
            progress(1)
    for line in confusion.lines() if confusion else ():
        say(line)
    if args.out:
        _write(Path(args.out), {result.blob: result.array() for result in results})


def _shown(args: argparse.Namespace) -> Shown:
    """Which classes or detections are shown: by default the best, with --threshold all above it."""
    if args.threshold is None:
        return Shown(args.top or TOP, -np.inf)
    return Shown(args.top, args.threshold)


def _images(
    each_pass: Iterator[Pass], results: Sequence[Results]
) -> Iterator[tuple[str, Array, Sequence[Array]]]:
    """The path and the pixels of each image, and its values in the blob of each result, to which
    they are added.
    """
    for paths, images, arrays in each_pass:
        values = [result.add(arrays[result.blob], len(paths)) for result in results]
        yield from zip(paths, images, zip(*values))


def _print(path: str, lines: Iterable[str]) -> None:
    """Print the lines about an image, the first behind its path."""
    first, *others = lines
    say(f"{path}: {first}", *others, sep="\n")


def _paths(images: Sequence[str], root: str) -> tuple[list[str], list[int]]:
    """The paths of images, with folders and lists replaced by what they name, and the labels if
    all are in lists.

    Raises DataError.
    """
    paths: list[str] = []
    truth: list[int] = []
    for image in images:
        if image.lower().endswith(".txt"):
            items = read_list(Path(image))[0]
            paths += [str(find(root + name, image)) for name, _ in items]
            truth += [label for _, label in items]
        elif Path(image).is_dir():
            found = pictures_in(Path(image))
            if not found:
                raise DataError(
                    f"{image}: no picture in this folder ({', '.join(PICTURES)}){_folders_in(image)}"
                )
            paths += found
        else:
            paths.append(image)
    return paths, truth if len(truth) == len(paths) else []


def _folders_in(folder: str) -> str:
    """Advice on a folder that has folders only; empty for others."""
    folders = [path for path in sorted(Path(folder).iterdir()) if path.is_dir()]
    return f"; give the folders in it, such as {folders[0]}" if folders else ""


def _blobs(net: Net, args: argparse.Namespace) -> Sequence[str]:
    """The names of the blobs to print or write. Raises NetlibError."""
    blobs = args.blob or net.outputs
    if not blobs:
        raise NetlibError(
            f"{args.net}: no layer leaves a blob unread, so the net has no output; name one with --blob"
        )
    if wrong := [blob for blob in blobs if blob not in net.blobs]:
        last = ", ".join(list(net.blobs)[-8:])
        advice = did_you_mean(wrong[0], net.blobs) or f"; its last are {last}"
        raise NetlibError(f"{args.net}: the net has no blob {wrong[0]!r}{advice}")
    if args.out and args.out.endswith(".npy") and len(blobs) > 1:
        raise NetlibError(
            f"{args.out}: a .npy file holds one array, found {', '.join(blobs)}; expected .npz or --blob"
        )
    return blobs


def _pictures(draw: Path, paths: Sequence[str], results: Sequence[Results]) -> list[Path]:
    """The paths of the pictures of detections. Raises NetlibError."""
    if len(results) > 1 or not results[0].classes:
        raise NetlibError(
            f"{draw}: blob {results[0].blob!r} holds no detections; --draw needs a net that ends in a "
            "DetectionOutput layer"
        )
    if draw.suffix.lower() in (".jpg", ".png"):
        if len(paths) > 1:
            raise NetlibError(f"{draw}: one file for {len(paths)} images; expected a folder")
        outputs.check_place(draw, paths)
        return [draw]
    outputs.make_folder(draw)
    return outputs.places(paths, draw, ".jpg")


def _confusion(
    blobs: Sequence[str], labels: Sequence[str] | None, truth: Sequence[int]
) -> Confusion:
    """An empty table of confusions. Raises NetlibError."""
    if not truth:
        raise NetlibError("--confusion needs lists of images with their labels (.txt)")
    if len(blobs) > 1 or not labels:
        raise NetlibError("--confusion needs one blob of classes, and --labels with their names")
    return Confusion(labels)


def _write(out: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays by the suffix of the file's name."""

    fill = _write_npy if out.suffix.lower() == ".npy" else _write_npz
    atomic.replace(out, lambda path: fill(path, arrays))
    shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    say(f"wrote {out}: {shapes}")


def _write_npy(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write the only one of the arrays."""
    (array,) = arrays.values()
    with path.open("wb") as file:
        np.lib.format.write_array(file, array, allow_pickle=False)


def _write_npz(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays by name; numpy.savez does not accept every name."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


if __name__ == "__main__":
    sys.exit(main())
