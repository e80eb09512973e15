#!/usr/bin/env python3
"""Fine-tune a classifier for classes of your own: one folder of pictures for each.

    python tools/finetune.py deploy.prototxt net.caffemodel pictures/ --mean 104,117,123 --scale 1
    python tools/finetune.py deploy.prototxt net.caffemodel pictures/ \\
        --mean 104,117,123 --scale 1 --freeze conv3
    python tools/finetune.py deploy.prototxt net.caffemodel pictures/ \\
        --mean-file mean.binaryproto --scale 1 --mirror

pictures/ has a folder for each class, called as the class. The last layer is replaced by one for
these classes and trained; the other layers keep their weights, unless --freeze says otherwise. A
part of each folder is held out, and tested at the end. The folder --out receives all that is needed
to train again, and to run the result: train.prototxt, solver.prototxt, deploy.prototxt, labels.txt,
the lists train.txt and test.txt, the weights, and the log. The mean and the scale are those with
which the net was trained; its author knows them (docs/caffe_nets.md has many).
"""

from __future__ import annotations

import argparse
import logging
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from layers.data.images import read_image
from netlib.distributed.ranks import ALONE
from netlib.errors import DataError, NetlibError
from netlib.files import atomic
from netlib.files.paths import list_folder
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.binaryproto import write_blob
from tools.common import training, training_log
from tools.common.arguments import add_engine, count, natural, parser_of, positive_number, real
from tools.common.commands import command
from tools.common.console import DONE, duration, guarded, notify, say
from tools.common.deploy_nets import refuse_training_net
from tools.common.frozen_features import HeadSolver, NotFrozenError, use_features
from tools.common.net_images import (
    PICTURES,
    Preprocessing,
    add_value_options,
    passes,
    pictures_in,
    preprocessing_of,
)
from tools.common.net_results import Confusion
from tools.common.new_classes import NewClasses

log = logging.getLogger("netlib")
EPOCHS, MIN_ITERATIONS = 20, 300
MEAN_FILE = "mean.binaryproto"
SOLVER = """net: "{net}"
test_iter: {test_iter} test_interval: {test_interval}
type: "Adam" base_lr: {rate:g} lr_policy: "step" gamma: 0.1 stepsize: {step} momentum: 0.9 momentum2: 0.999
weight_decay: 0.0005 max_iter: {max_iter} display: {display} random_seed: {seed}
snapshot_prefix: "{prefix}"
weights: {weights}
"""
DATA = """layer {{
  name: "pictures" type: "ImageData" top: "{data}" top: "label" include {{ phase: {phase} }}
  image_data_param {{
    source: "{source}" batch_size: {batch} new_height: {height} new_width: {width} is_color: {color} shuffle: {shuffle}
  }}
  transform_param {{ {transform} scale: {scale!r} mirror: {mirror} }}
}}
"""
TO_RGB = """layer {{ name: "bgr" type: "Slice" bottom: "{0}_bgr" top: "{0}_b" top: "{0}_g" top: "{0}_r" }}
layer {{ name: "rgb" type: "Concat" bottom: "{0}_r" bottom: "{0}_g" bottom: "{0}_b" top: "{0}" }}
"""


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "net", metavar="NET", help="deploy prototxt of the net, with its input and Softmax"
    )
    parser.add_argument("weights", metavar="WEIGHTS", help="*.caffemodel or *.caffemodel.h5")
    parser.add_argument(
        "pictures", metavar="PICTURES", type=Path, help="folder with a folder for each class"
    )
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, default=Path("finetuned"), help="default: %(default)s"
    )
    add_value_options(
        parser.add_argument_group("preprocessing with which the net was trained"), None
    )
    _add_training_options(parser)
    add_engine(parser)
    args = parser.parse_args(argv)
    if not (args.mean or args.mean_file) or args.scale is None:
        parser.error(
            "give --mean or --mean-file, and --scale, with which the net was trained: --mean 104,117,123 "
            "--scale 1 is usual, MobileNet has --scale 0.017 (docs/caffe_nets.md); --mean 0 if there is none"
        )
    return guarded(run, args)


def _add_training_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for what is trained, on which pictures, and how long."""
    parser.add_argument(
        "--freeze",
        metavar="all|none|LAYER",
        default="all",
        help="layers that keep their weights: all but the new one, none, or those up to a layer "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--held-out",
        type=real(0, 0.9, above=True),
        default=0.2,
        metavar="SHARE",
        help="share of each class to test on, at least one picture (default: %(default)s)",
    )
    parser.add_argument(
        "--iterations",
        type=count,
        metavar="N",
        help=f"steps of training (default: {EPOCHS} passes over the pictures, at least "
        f"{MIN_ITERATIONS})",
    )
    parser.add_argument(
        "--batch",
        type=count,
        default=32,
        metavar="N",
        help="pictures per step (default: %(default)s)",
    )
    parser.add_argument(
        "--rate",
        type=positive_number,
        default=5e-4,
        metavar="R",
        help="learning rate, for the new layer ten times as high (default: %(default)s)",
    )
    parser.add_argument("--mirror", action="store_true", help="train on mirror images, too")
    parser.add_argument(
        "--seed",
        type=natural,
        default=1,
        metavar="N",
        help="of the held-out part, the new weights and the order (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Write the files, train and test. Raises NetlibError."""
    refuse_training_net(args.net)
    old = Net(args.net, args.weights, netlib.TEST, engine=args.engine)
    preprocessing = preprocessing_of(old, args)
    classes = pictures_of(args.pictures, color=len(preprocessing.mean) == 3)
    nets = NewClasses(old, len(classes))
    frozen = nets.frozen(args.freeze)
    train, test = split(classes, args.held_out, args.seed)
    _new_folder(args.out)
    data = _data(args, old.inputs[0], preprocessing, len(train), len(test))
    training_net = nets.training(data, frozen)
    files = {
        "labels.txt": "\n".join(classes),
        "train.txt": _listed(train),
        "test.txt": _listed(test),
        "train.prototxt": str(schema.to_tree(training_net)),
        "deploy.prototxt": str(schema.to_tree(nets.deploy())),
        "solver.prototxt": _solver(args, len(train), len(test)),
    }
    for name, text in files.items():
        atomic.replace_text(args.out / name, text.rstrip("\n") + "\n")
    notify(
        f"{len(classes)} classes, {len(train)} pictures to train on, {len(test)} held out; layer {nets.head!r} becomes "
        f"{nets.name!r}; layers that keep their weights: {len(frozen)}"
    )
    status = _train(args, old, preprocessing)
    if status != DONE:
        return status
    (weights,) = args.out.glob("net_iter_*.caffemodel")
    return _test(args, weights, list(classes), test, preprocessing)


def _new_folder(out: Path) -> None:
    """Create the folder. Raises NetlibError if it has the files of an earlier run."""
    if (out / "solver.prototxt").exists():
        raise NetlibError(
            f"{out}: has the files of an earlier run; delete it, or give another --out"
        )
    out.mkdir(parents=True, exist_ok=True)


def _train(args: argparse.Namespace, old: Net, how: Preprocessing) -> int:
    """Train with a line for each test, and the log in its file; returns the exit status.

    Raises NetlibError.
    """
    with training_log.logged(ALONE, args.out / "train.log") as console:
        console.setLevel(logging.WARNING)
        log.info("Use CPU, %s", training.set_up_engine(args.engine, ALONE))
        path = args.out / "solver.prototxt"
        solver = training.new_solver(
            path, weights=[args.weights], engine=args.engine, kind=HeadSolver
        )
        assert isinstance(solver, HeadSolver)
        if file := console.file:
            solver.on_step.append(lambda: file.begin([]))
        try:
            seconds = use_features(solver, old, how)
            notify(
                f"the layers before {solver.first_layer!r} are computed once for each picture: {duration(seconds)}"
            )
        except NotFrozenError as why:
            notify(f"all layers are computed in each step: {why}")
        solver.on_test = partial(_print_accuracy, solver, console)
        status = training.solve(solver, console)
    if status != DONE:
        training.say_how_to_continue(
            solver, {"--engine": args.engine, "--log": args.out / "train.log"}
        )
    return status


def _print_accuracy(
    solver: HeadSolver, console: training_log.BarHandler, means: Mapping[str, Any]
) -> None:
    """Print the accuracy on the held-out pictures, if a test has it among its means."""
    if "accuracy" in means:
        step = f"step {solver.iter} of {solver.param.max_iter}"
        console.print(f"{step}: accuracy {means['accuracy'].item():.2f}")


def pictures_of(folder: Path, color: bool) -> dict[str, list[str]]:
    """The paths of the pictures of each class, sorted.

    Raises DataError, also for one that cannot be read.
    """
    classes: dict[str, list[str]] = {}
    for name in sorted(list_folder(folder)):
        if (folder / name).is_dir() and not name.startswith("."):
            classes[name] = sorted(pictures_in(folder / name))
    if len(classes) < 2:
        found = ", ".join(["one class", *map(repr, classes)]) if classes else "no folder in it"
        raise DataError(
            f"{folder}: {found}; expected a folder of pictures for each of two or more classes"
        )
    for name, paths in classes.items():
        if len(paths) < 2:
            raise DataError(
                f"{folder / name}: {len(paths)} pictures ({', '.join(PICTURES)}); expected at least two, "
                "one of them to test on"
            )
        if name != name.strip() or not name.isprintable():
            raise DataError(
                f"{folder / name}: expected a name without line breaks and outer spaces"
            )
    for path in (path for paths in classes.values() for path in paths):
        read_image(Path(path), color)
    return classes


def split(
    classes: Mapping[str, Sequence[str]], share: float, seed: int
) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
    """Paths and classes to train on, and those to test on: of each class the ``share``, at least
    one, by the seed.
    """
    rng = np.random.default_rng(seed)
    parts: tuple[list[tuple[str, int]], list[tuple[str, int]]] = ([], [])
    for number, paths in enumerate(classes.values()):
        held = min(max(1, round(share * len(paths))), len(paths) - 1)
        chosen = set(rng.permutation(len(paths))[:held].tolist())
        for i, path in enumerate(paths):
            parts[i in chosen].append((path, number))
    return parts


def _listed(items: Sequence[tuple[str, int]]) -> str:
    return "\n".join(f"{path} {number}" for path, number in items)


def _data(args: argparse.Namespace, name: str, how: Preprocessing, train: int, test: int) -> str:
    """The text of the layers that read the pictures; writes the file of a mean image.

    Raises NetlibError.
    """
    width, height = how.resize
    same = {
        "data": f"{name}_bgr" if args.rgb else name,
        "height": height,
        "width": width,
        "color": str(len(how.mean) == 3).lower(),
        "transform": _mean_option(args, how),
        "scale": args.scale,
    }
    to_train = DATA.format(
        phase="TRAIN",
        source=args.out / "train.txt",
        batch=min(args.batch, train),
        shuffle="true",
        mirror=str(args.mirror).lower(),
        **same,
    )
    to_test = DATA.format(
        phase="TEST",
        source=args.out / "test.txt",
        batch=_divisor(test, args.batch),
        shuffle="false",
        mirror="false",
        **same,
    )
    return to_train + to_test + (TO_RGB.format(name) if args.rgb else "")


def _mean_option(args: argparse.Namespace, how: Preprocessing) -> str:
    """The fields of ``transform_param`` for the mean; writes the file of a mean image.

    Raises NetlibError.
    """
    mean = how.mean[::-1] if args.rgb else how.mean
    if mean.shape[1:] == (1, 1):
        return " ".join(f"mean_value: {value!r}" for value in mean.ravel().tolist())
    width, height = how.size
    if width != height:
        raise NetlibError(
            f"{args.net}: the input has {width} x {height} px; with --mean-file expected "
            "a square, which is cut from the picture; --mean takes any"
        )
    path = args.out / MEAN_FILE
    write_blob(mean[None].astype(np.float32), path)
    return f'mean_file: "{path}" crop_size: {width}'


def _divisor(number: int, most: int) -> int:
    """The largest divisor of a number up to ``most``: the batch with which each picture
    is tested once.
    """
    return max(i for i in range(1, min(number, most) + 1) if number % i == 0)


def _solver(args: argparse.Namespace, train: int, test: int) -> str:
    epoch = math.ceil(train / min(args.batch, train))  # iterations
    max_iter = args.iterations or max(EPOCHS * epoch, MIN_ITERATIONS)
    return SOLVER.format(
        net=args.out / "train.prototxt",
        test_iter=test // _divisor(test, args.batch),
        rate=args.rate,
        test_interval=max(1, max_iter // 10),
        step=max(1, 2 * max_iter // 3),
        max_iter=max_iter,
        display=max(1, max_iter // 20),
        seed=args.seed,
        prefix=args.out / "net",
        weights=prototxt.Scalar("string", str(args.weights), prototxt.Place("")),
    )


def _test(
    args: argparse.Namespace,
    weights: Path,
    labels: list[str],
    test: Sequence[tuple[str, int]],
    how: Preprocessing,
) -> int:
    """Print the confusions of the held-out pictures, and the command that repeats it."""
    net = Net(args.out / "deploy.prototxt", weights, netlib.TEST, engine=args.engine)
    confusion = Confusion(labels)
    (output,) = net.outputs
    truth = dict(test)
    for paths, _, arrays in passes(net, list(truth), how, [output]):
        for path, values in zip(paths, arrays[output]):
            confusion.add(path, truth[path], values)
    say(*confusion.lines(), sep="\n")
    say(f"the same again: {command('run_net')} {shlex.join(_words(args, weights))}")
    return DONE


def _words(args: argparse.Namespace, weights: Path) -> list[str]:
    """The arguments of run_net that repeat the test."""
    files = [args.out / "deploy.prototxt", weights, args.out / "test.txt"]
    mean = ["--mean-file", args.mean_file]
    if not args.mean_file:
        mean = ["--mean", ",".join(f"{value:g}" for value in args.mean)]
    scale = ["--scale", f"{args.scale:g}", *["--rgb"] * args.rgb]
    labels = ["--labels", args.out / "labels.txt", "--confusion"]
    return [str(word) for word in (*files, *mean, *scale, *labels)]


if __name__ == "__main__":
    sys.exit(main())
