#!/usr/bin/env python3
"""The paper's Table 1: train its four networks, and DeepPrior's, on the same data, and compare them.

    make table1                         or: python tools/table1.py --iterations 10000

The data are those of data/nyu: synthetic hands (tools/make_synthetic.py) or the NYU data set (tools/prepare_nyu.py).
All networks are trained with the paper's solver; snapshots and logs go to snapshots/table1, and a stopped run goes on
where it was. The table, the figures and the text around them are written to docs/results.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from handpose.drawing.comparisons import side_by_side
from handpose.experiments import table1_page
from handpose.experiments.networks import NETWORKS
from handpose.experiments.results import Answers, angles_of, result_of
from handpose.experiments.trainings import data_name, training_of
from handpose.experiments.true_angles import fit_true_angles
from handpose.predicting.nets import crops_of, trained
from handpose.scoring.held_out import predict_all
from handpose.scoring.published_predictions import nyu_benchmark, score_on
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib import atomic
from netlib.blob import Array
from netlib.errors import NetlibError, reason_of
from netlib.hdf5 import read_list
from netlib.net import Net
from tools import pictures, plots, training
from tools.advice import on_missing_data
from tools.arguments import natural, parser_of, positive
from tools.console import DONE, duration, guarded, say

DATA, ANGLES = Path("data/nyu"), Path("data/nyu_angles")  # as the prototxt files of the networks have them
RESULTS = Path(__file__).resolve().parent.parent / "docs" / "results"
DRAWN = 4  # frames in the picture of hands


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("--iterations", type=positive, default=10000, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=natural, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="FOLDER", help="default: docs/results")
    parser.add_argument("--work", type=Path, default=Path("snapshots/table1"), metavar="FOLDER",
                        help="where snapshots and logs go (default: %(default)s)")  # fmt: skip
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train what is not trained yet, evaluate, write."""
    skeleton = skeletons.load()
    with on_missing_data():
        files = {split: read_list(str(DATA / f"{split}.txt"), None) for split in ("train", "test")}
    for folder in (args.work, args.out):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NetlibError(f"{folder}: cannot make the folder: {reason_of(error)}") from None
    work = args.work / data_name(files["train"])  # networks trained on other data are other networks
    work.mkdir(exist_ok=True)
    for split in ("train", "test"):
        truth = _fit(split, files[split], skeleton)
    found = []
    for network in NETWORKS:
        planned = training_of(network, files["train"], work, args.iterations, args.seed)
        if not planned.final.is_file():
            _say(f"training {network.title}: {planned}")
            weights = [planned.weights] if planned.weights else []
            status = training.train(planned.solver, snapshot=planned.snapshot, weights=weights, log_file=planned.log)
            if status != DONE:
                return status
        predictions = predict_all(trained(network.model, planned.final))
        if predictions.dof is None:
            _say(f"{network.title}: fitting the hand to {len(predictions.joints)} frames of predicted joints")
        found.append(Answers(network, predictions, angles_of(predictions, skeleton)))
    _write(args, found, truth, skeleton)
    return DONE


def _fit(split: str, files: Sequence[Path], skeleton: Skeleton) -> Array:
    """The true angles of a split, fitted if that is not done yet: inputs (N, D)."""
    begun = time.perf_counter()
    inputs, residuals = fit_true_angles(split, files, ANGLES, skeleton)
    _say(f"{split}: the hand fitted to {len(inputs)} frames, {np.nanmean(residuals):.2f} mm left, "
         f"{duration(time.perf_counter() - begun)}")  # fmt: skip
    return inputs


def _write(args: argparse.Namespace, found: Sequence[Answers], truth: Array, skeleton: Skeleton) -> None:
    """The page with its pictures, and the figures as JSON; the page is printed, too."""
    first = found[0].predictions
    made_from, frames = first.made_from, len(first.joints)
    benchmark = replace(nyu_benchmark(), name=f"test set ({made_from})")
    scores = {answers.network.title: score_on(benchmark, answers.joint_errors()) for answers in found}
    plots.plot_joint_errors(scores, benchmark, frames, args.out / table1_page.JOINTS)
    _say(f"wrote {args.out / table1_page.JOINTS}")
    errors = {answers.network.title: answers.angle_errors(truth, skeleton) for answers in found}
    plots.plot_angle_errors(errors, skeleton, args.out / table1_page.ANGLES)
    _draw(args.out / table1_page.HANDS, found, skeleton)
    results = {answers.network.name: result_of(answers, truth, skeleton) for answers in found}
    networks = [answers.network for answers in found]
    page = table1_page.page_of(networks, results, made_from, frames, args.iterations, args.seed)
    atomic.replace_text(args.out / "table1.md", page)
    figures = {"iterations": args.iterations, "seed": args.seed, "data": made_from, "frames": frames,
               "networks": {name: asdict(result) for name, result in results.items()}}  # fmt: skip
    atomic.replace_text(args.out / "table1.json", json.dumps(figures, indent=2) + "\n")
    print(page)


def _draw(path: Path, found: Sequence[Answers], skeleton: Skeleton) -> None:
    """The hands of all networks in a few frames, of small to large error of ours."""
    ours = next(answers.predictions for answers in found if answers.network.name == "ours")
    order = np.argsort(np.linalg.norm(ours.joints - ours.truth, axis=2).mean(axis=1))
    chosen = order[(np.linspace(0.1, 0.9, DRAWN) * (len(order) - 1)).astype(int)]
    crops = crops_of(Net(found[0].network.model, netlib.TEST), chosen)
    methods = {answers.network.title: answers.predictions.joints[chosen] for answers in found}
    sheet = side_by_side(crops, methods, ours.truth[chosen], skeleton, ours.half_cube[chosen])
    pictures.write_image(path, sheet)


def _say(text: str) -> None:
    say(text, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
