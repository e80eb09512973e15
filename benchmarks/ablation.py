#!/usr/bin/env python3
"""Ablation of the recipes for synthetic hands: short training runs, each with one change.

    python benchmarks/ablation.py --iterations 1500 --seeds 1 2
    python benchmarks/ablation.py --recipe cameras              # sensors, sleeves, distances, rotations

Every run trains with prototxt/synthetic_solver.prototxt and one change; the learning rate rises over the first tenth of
the iterations and decays to 0 at the last. All are scored on the same held-out frames of the recipe. Data and weights
are written to snapshots/ablation. A finished run is not repeated if its prototxt files and training data are unchanged.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tools

tools.begin(__name__)

import numpy as np

from experiments.table1.recipes import with_fields
from handpose.datasets import parts
from handpose.estimate import nets
from handpose.scoring.held_out import figures_of, predict_all
from handpose.synthetic import prior_file, recipes, workers
from handpose.synthetic.generator import Generator, Recipe, View
from handpose.synthetic.many import generate
from handpose.synthetic.prior_file import BetaParameter
from handpose.synthetic.surface_prior import SurfacePrior
from layers.hand import skeleton
from netlib import engine
from netlib.errors import PrototxtError
from netlib.files import atomic
from netlib.proto import prototxt, schema
from netlib.proto.prototxt import Message
from tools.common import training
from tools.common.arguments import natural, parser_of, positive
from tools.common.console import DONE, guarded

NET = (ROOT / "prototxt" / "synthetic_train_test.prototxt").read_text(encoding="utf-8")
SOLVER = (ROOT / "prototxt" / "synthetic_solver.prototxt").read_text(encoding="utf-8")
DROPOUT = (
    'layer {{ name: "Dropout{0}" type: "Dropout" bottom: "{0}" top: "{0}" dropout_param {{ dropout_ratio: 0.3 }} }}\n'
)
HELD_OUT = 2000  # frames for scoring
HAND = prior_file.load()
NARROW = (
    HAND.turned("palm_rot_z", std=20.0, any=0.0).turned("palm_rot_x", std=16.0).turned("palm_rot_y", std=25.0, any=0.0)
)
_BEND = schema.changed(HAND.bend[0], independent=1.0, own=BetaParameter(1.0, 1.0), noise=0.3)
UNCURLED = HAND.but(bend=(_BEND,), spread=(schema.changed(HAND.spread[0], noise=0.3),))
SAME = HAND.but(scale_std=0, bone_std=0)


def _replaced(text: str, old: str, new: str) -> str:
    """``str.replace`` that raises ValueError if ``old`` is missing, as the study would then change nothing."""
    if old not in text:
        raise ValueError(f"the prototxt does not contain {old!r}, which this study changes")
    return text.replace(old, new)


def _with_dropout(net: str) -> str:
    for name in ("FC1", "FC2"):
        relu = f'layer {{ name: "ReLU{name}" type: "ReLU" bottom: "{name}" top: "{name}" }}\n'
        net = _replaced(net, relu, relu + DROPOUT.format(name))
    return net


def _with_sgd(solver: str) -> str:
    return _replaced(_replaced(solver, '"Adam"', '"SGD"'), "base_lr: 0.002", "base_lr: 0.003")


def _with_squares(net: str) -> str:
    net = _replaced(net, "SmoothL1Loss", "EuclideanLoss")
    net = _replaced(net, "smooth_l1_loss_param { sigma: 10 }", "")
    return _replaced(net, "loss_weight: 0.1", "loss_weight: 1")


def _without_second_head(net: str) -> str:
    return net[: net.index("# A second head")]


def _without_augmentation(net: str) -> str:
    start = net.index("# Augmentation: other views")
    return net[:start] + net[net.index("# Features") :]


@dataclass(frozen=True)
class Study:
    """A training run that differs from the reference in one setting."""

    name: str
    title: str
    frames: int | None = None  # None: as many as the other studies
    recipe: Recipe = recipes.recipe("nyu")  # for the training data
    net: Callable[[str], str] = str
    solver: Callable[[str], str] = str
    rampup: float = 0.1  # fraction of the iterations


OF_NYU = (
    Study("recipe", "the recipe"),
    Study("few", "5,000 frames instead of 50,000", frames=5000),
    Study("few_plain", "5,000 frames, no augmentation", frames=5000, net=_without_augmentation),
    Study("plain", "no augmentation", net=_without_augmentation),
    Study(
        "on_bones",
        "surface centred on the bones, not on the palmar side",
        recipe=Recipe(flesh=SurfacePrior(offsets=(0.0, 0.0))),
    ),
    Study("clean", "no sensor noise", recipe=Recipe(views=(View(sensor=None),))),
    Study("armless", "no forearm", recipe=Recipe(flesh=SurfacePrior(limb=(0.05, 0.05), cut=1.0, cut_at=(0.01, 0.01)))),
    Study("narrow", "narrow rotations of the palm", recipe=Recipe(NARROW)),
    Study("uncurled", "fingers curl independently", recipe=Recipe(UNCURLED)),
    Study("one_hand", "one hand: fixed size and bone lengths", recipe=Recipe(SAME, SurfacePrior(thickness_std=0))),
    Study("one_head", "no second head", net=_without_second_head),
    Study("dropout", "dropout 0.3", net=_with_dropout),
    Study("squares", "EuclideanLoss, the paper's", net=_with_squares),
    Study("at_once", "no learning rate warm-up", rampup=0),
    Study("sgd", "EuclideanLoss and SGD 0.003, the paper's", net=_with_squares, solver=_with_sgd),
)
CAMERAS, NYU = recipes.recipe("cameras"), recipes.recipe("nyu")


def _before_cameras(name: str, title: str, **changed: object) -> Study:
    return Study(name, title, recipe=replace(CAMERAS, **changed))  # type: ignore[arg-type]


OF_CAMERAS = (
    _before_cameras("recipe", "the recipe"),
    Study("nyu", "the recipe `nyu` instead", recipe=NYU),
    _before_cameras("no_sensor", "no sensor errors", views=tuple(View(v.camera, None) for v in CAMERAS.views)),
    _before_cameras(
        "one_sensor",
        "the sensor errors of NYU's camera for every camera",
        views=tuple(View(v.camera) for v in CAMERAS.views),
    ),
    _before_cameras("one_camera", "NYU's camera only", views=NYU.views),
    _before_cameras("bare", "no sleeves", flesh=replace(CAMERAS.flesh, sleeve=0.0)),
    _before_cameras("uncut", "no cut forearms", flesh=replace(CAMERAS.flesh, cut=0.0)),
    _before_cameras("same_flesh", "the surface of `nyu`: uncut, no sleeves, one shape", flesh=NYU.flesh),
    _before_cameras(
        "nyu_depth", "550 to 1000 mm away instead of 250 to 1200", prior=CAMERAS.prior.but(depth=NYU.prior.depth)
    ),
    _before_cameras(
        "upright",
        "the orientations of `nyu`: few hands point down",
        prior=CAMERAS.prior.but(turn=NYU.prior.turn),
    ),
)
STUDIES = {"nyu": OF_NYU, "cameras": OF_CAMERAS}


def main(argv: list[str] | None = None) -> int:
    """Run the studies; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("--iterations", type=positive, default=1500, metavar="N", help="default: %(default)s")
    parser.add_argument("--frames", type=positive, default=50000, metavar="N",
                        help="frames of the training data (default: %(default)s)")
    parser.add_argument("--seeds", type=natural, nargs="+", default=[1, 2], metavar="N", help="default: 1 2")
    parser.add_argument("--recipe", choices=STUDIES, default="nyu",
                        help=f"{' or '.join(STUDIES)} (default: %(default)s)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="studies to run (default: all)")
    parser.add_argument("--work", type=Path, default=Path("snapshots/ablation"), metavar="FOLDER",
                        help="folder for data and weights (default: %(default)s)")
    args = parser.parse_args(argv)
    names = [study.name for study in STUDIES[args.recipe]]
    for name in args.only or []:
        if name not in names:
            parser.error(f"--only {name}: expected {', '.join(names)}")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train and score the studies; returns the exit status."""
    if args.recipe != "nyu":
        args.work = args.work / args.recipe
    args.work.mkdir(parents=True, exist_ok=True)
    base = recipes.recipe(args.recipe)
    test = write_frames(args.work / "test", Generator(split="test", recipe=base), HELD_OUT)
    rows = ["| | 14 joints, mm | by seed |", "|---|---|---|"]
    for study in (s for s in STUDIES[args.recipe] if not args.only or s.name in args.only):
        frames = study.frames or args.frames
        name = f"{study.name}_{frames}" if study.recipe != base else str(frames)
        data = write_frames(args.work / f"data_{name}", Generator(recipe=study.recipe), frames)
        errors = []
        for seed in args.seeds:
            status, weights, net = trained(study, data, test, seed, args)
            if status != DONE:
                return status
            figures = figures_of(predict_all(nets.trained(net, weights)), skeleton.load())
            errors.append(figures["error_14_mm"])
        rows.append(f"| {study.title} | {np.mean(errors):.1f} | {', '.join(f'{e:.1f}' for e in errors)} |")
        print(rows[-1], file=sys.stderr, flush=True)
    print("\n".join(rows))
    return DONE


def write_frames(prefix: Path, generator: Generator, count: int) -> Path:
    """Generate frames in one file with its list, unless they exist; returns the list."""
    part = parts.Part(prefix.with_suffix(".h5"), count, repr(generator.made_from()))
    if not parts.is_whole(part):
        with workers.processes(engine.available_cpus()) as pool:
            pieces = (frames.arrays() for frames in generate(count, generator, pool))
            parts.write_part(part, generator.columns(), pieces, lambda: {"made_from": "synthetic"})
    atomic.replace_text(prefix.with_suffix(".txt"), parts.list_text([part.path]))
    return prefix.with_suffix(".txt")


def trained(study: Study, data: Path, test: Path, seed: int, args: argparse.Namespace) -> tuple[int, Path, Path]:
    """Train a study unless it is finished; returns the exit status, the weights and the net."""
    prefix = args.work / f"{study.name}_{args.iterations}_seed{seed}"
    weights, net = Path(f"{prefix}_iter_{args.iterations}.caffemodel.h5"), Path(f"{prefix}_net.prototxt")
    net_text = _replaced(study.net(NET), "data/nyu/train.txt", str(data))
    net_text = _replaced(net_text, "data/nyu/test.txt", str(test))
    own = {"net": net, "max_iter": args.iterations, "display": 500, "random_seed": seed}
    own |= {"rampup_interval": round(study.rampup * args.iterations)}
    own |= {"snapshot_format": "HDF5", "snapshot_prefix": prefix}
    net_text += f"# data {_recipe_sum(data)}\n"  # weights of data regenerated since are not reused
    solver, tree = Path(f"{prefix}.prototxt"), with_fields(prototxt.parse(study.solver(SOLVER)), own)
    if weights.is_file() and atomic.text_of(net) == net_text and _tree_of(solver) == tree:
        return DONE, weights, net
    weights.unlink(missing_ok=True)
    atomic.replace_text(net, net_text)
    atomic.replace_text(solver, str(tree))
    return training.train(solver), weights, net


def _recipe_sum(data: Path) -> str:
    """Return a checksum of the recipe that the data file of a list was generated from."""
    recipe = (parts.attributes(data.with_suffix(".h5")) or {}).get("recipe")
    return hashlib.sha256(str(recipe).encode()).hexdigest()[:16]


def _tree_of(path: Path) -> Message | None:
    """Parse a prototxt; None if it is missing or malformed."""
    try:
        return prototxt.parse(atomic.text_of(path) or "", str(path))
    except PrototxtError:
        return None


if __name__ == "__main__":
    sys.exit(main())
