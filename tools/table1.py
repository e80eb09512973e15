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
import re
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.data import parts
from handpose.drawing import hands, sheets
from handpose.facts import nyu
from handpose.fitting import angles, companions
from handpose.fitting.levenberg_marquardt import fit_joints
from handpose.predicting.nets import data_layer
from handpose.scoring import metrics
from handpose.scoring.held_out import Predictions, figures_of, predict_all
from handpose.scoring.published_predictions import nyu_benchmark, score_on
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib import atomic
from netlib.errors import NetlibError, reason_of
from netlib.hdf5 import read_list
from netlib.net import Net
from tools import evaluate, pictures, train
from tools.console import DONE, duration, guarded, natural, positive

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parent.parent
DATA, ANGLES = Path("data/nyu"), Path("data/nyu_angles")
SOLVER = ROOT / "prototxt" / "nyu_solver.prototxt"
RIDGE = 3e-4  # of the true angles, fitted to the annotated joints; enough where 31 of them determine nearly all
BOTTLENECK = 30  # components


@dataclass(frozen=True)
class Network:
    """One line of the table."""

    name: str
    title: str
    model: Path
    paper: str  # the paper's angle error on NYU
    by_fit: bool = False  # its angles are those of a hand fitted to its joints


NETWORKS = (
    Network("direct_joint", "direct joint", ROOT / "prototxt/table1/direct_joint.prototxt", "21.4°", by_fit=True),
    Network("direct_parameter", "direct parameter", ROOT / "prototxt/table1/direct_parameter.prototxt", "–"),
    Network("no_limit", "ours without PhysLimit", ROOT / "prototxt/table1/no_limit.prototxt", "–"),
    Network("ours", "ours", ROOT / "prototxt/nyu_train_test.prototxt", "12.2°"),
    Network("bottleneck", "DeepPrior's bottleneck", ROOT / "prototxt/table1/bottleneck.prototxt", "–", by_fit=True),
)


@dataclass(frozen=True)
class Result:
    """What a network reached on the test set."""

    error_14_mm: float
    error_mm: float
    angle_deg: float  # mean over the 23 rotations
    out_of_limits: float | None  # fraction of frames; None for networks without angles
    within_40_mm: float


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=positive, default=10000, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=natural, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "results", metavar="FOLDER", help="default: docs/results"
    )
    parser.add_argument(
        "--work", type=Path, default=Path("snapshots/table1"), metavar="FOLDER", help="default: %(default)s"
    )
    args = parser.parse_args(argv)
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Train what is not trained yet, evaluate, write."""
    skeleton = skeletons.load()
    with train.with_advice():
        files = {split: read_list(str(DATA / f"{split}.txt"), None) for split in ("train", "test")}
    for folder in (args.work, args.out):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NetlibError(f"{folder}: cannot make the folder: {reason_of(error)}") from None
    args.work = args.work / data_name(files["train"])  # networks trained on other data are other networks
    args.work.mkdir(exist_ok=True)
    truth = fit_angles(files, skeleton)
    found: dict[str, tuple[Network, Predictions, Array]] = {}
    for network in NETWORKS:
        weights, status = trained(network, files["train"], args)
        if status != DONE:
            return status
        predictions = predict_all(Net(network.model, weights, netlib.TEST))
        found[network.name] = (network, predictions, angles_of(network, predictions, skeleton))
    results = {name: result_of(p, inputs, truth, skeleton) for name, (_, p, inputs) in found.items()}
    write(args, found, results, truth, skeleton)
    return DONE


# ------------------------------------------------------------------------------------------ the parts


def data_name(files: Sequence[Path]) -> str:
    """A folder name for training data: where they are from, and a checksum of all that they depend on."""
    facts = [(path.name, path.stat().st_size, parts.attributes(path) or {}) for path in files]
    origin = str(facts[0][2].get("made_from", "unknown")).lower()
    recipes = "\n".join(f"{name} {found.get('recipe', size)}" for name, size, found in facts)
    return f"{re.sub(r'[^a-z0-9]+', '_', origin)}_{zlib.crc32(recipes.encode()):08x}"


def fit_angles(files: dict[str, list[Path]], skeleton: Skeleton) -> Array:
    """Fit the hand to all annotated joints, if that is not done yet; returns the inputs of the test frames."""
    inputs = []
    for split, paths in files.items():
        targets = companions.companions_of(paths, ANGLES)
        begun, residuals = time.perf_counter(), []
        for path, target in zip(paths, targets):
            residuals.append(companions.fit_file(path, target, skeleton, ridge=RIDGE))
        atomic.replace_text(ANGLES / f"{split}.txt", parts.list_text(targets))
        mean, took = float(np.nanmean(np.concatenate(residuals))), duration(time.perf_counter() - begun)
        _say(f"{split}: the hand fitted to {sum(map(len, residuals))} frames, {mean:.2f} mm left, {took}")
        if split == "test":
            for target in targets:
                with h5py.File(target, "r") as file:
                    inputs.append(file["dof"][...].astype(np.float64))
    return np.concatenate(inputs)


def trained(network: Network, files: Sequence[Path], args: argparse.Namespace) -> tuple[Path, int]:
    """The weights of a network after the iterations asked for, and the exit status of its training."""
    labels = f"_ridge{RIDGE:g}_v{companions.VERSION}" if network.name == "direct_parameter" else ""
    prefix = args.work / f"{network.name}{labels}_seed{args.seed}_of{args.iterations}"
    final = Path(f"{prefix}_iter_{args.iterations}.caffemodel.h5")
    if final.is_file():
        return final, DONE
    solver = Path(f"{prefix}.prototxt")
    atomic.replace_text(solver, solver_text(network, prefix, args.iterations, args.seed))
    argv = [str(solver), "--log", f"{prefix}.log"]
    states = list(args.work.glob(f"{prefix.name}_iter_*.solverstate.h5"))  # the last file of a snapshot to be written
    if states:
        latest = max(states, key=done)
        argv = [str(solver), "--snapshot", str(latest), "--log", f"{prefix}_from_{done(latest)}.log"]
    elif network.name == "bottleneck":
        weights = args.work / "principal_components.caffemodel.h5"
        write_components(weights, files)
        argv += ["--weights", str(weights)]
    _say(f"training {network.title}: {' '.join(argv)}")
    return final, train.main(argv)


def done(state: Path) -> int:
    """The iteration of a snapshot."""
    return int(re.findall(r"_iter_(\d+)\.", state.name)[-1])


def solver_text(network: Network, prefix: Path, iterations: int, seed: int) -> str:
    """The paper's solver for a network: its own text, with these iterations, no tests, and five snapshots."""
    own = {
        "net": network.model,
        "stepvalue": max(1, iterations * 9 // 10),
        "max_iter": iterations,
        "display": 100,
        "snapshot": max(1, iterations // 5),
        "snapshot_format": "HDF5",
        "snapshot_prefix": prefix,
        "random_seed": seed,
    }
    return train.with_fields(SOLVER.read_text(encoding="utf-8"), own)


def write_components(path: Path, files: Sequence[Path]) -> None:
    """Weights of the layer "joints": the mean of the training joints and their largest principal components.

    DeepPrior's last layer (Oberweger et al. 2015, Sec. 3.2). Components are scaled by their standard deviation, so
    that the numbers of the bottleneck have about unit size.
    """
    count, total, products = 0, 0.0, 0.0
    for source in files:
        with h5py.File(source, "r") as file:
            joints = file["joint"][...].astype(np.float64)
        count, total, products = count + len(joints), total + joints.sum(axis=0), products + joints.T @ joints
    mean = np.asarray(total / count)
    values, vectors = np.linalg.eigh(products / count - np.outer(mean, mean))
    scaled = vectors[:, ::-1][:, :BOTTLENECK] * np.sqrt(np.maximum(values[::-1][:BOTTLENECK], 0))

    def fill(temporary: Path) -> None:
        with h5py.File(temporary, "w") as file:
            file["data/joints/0"], file["data/joints/1"] = scaled.astype(np.float32), mean.astype(np.float32)

    atomic.replace(path, fill)


def angles_of(network: Network, predictions: Predictions, skeleton: Skeleton) -> Array:
    """Inputs (N, 47) of the hand that a network predicts: its own, or fitted within the limits to its joints."""
    if predictions.dof is not None:
        return np.where(skeleton.fixed, 0.0, predictions.dof.astype(np.float64))
    _say(f"{network.title}: fitting the hand to {len(predictions.joints)} frames of predicted joints")
    return fit_joints(skeleton, predictions.joints.astype(np.float64), limits=True, starts=4).inputs


def result_of(p: Predictions, inputs: Array, truth: Array, skeleton: Skeleton) -> Result:
    """The figures of a network."""
    figures = figures_of(p, skeleton)
    return Result(
        error_14_mm=figures["error_14_mm"],
        error_mm=figures["error_mm"],
        angle_deg=float(angles.angle_errors(skeleton, inputs, truth).mean()),
        out_of_limits=figures.get("out_of_limits"),
        within_40_mm=figures["within_40_mm"],
    )


# ------------------------------------------------------------------------------------------ the report


def write(
    args: argparse.Namespace,
    found: dict[str, tuple[Network, Predictions, Array]],
    results: dict[str, Result],
    truth: Array,
    skeleton: Skeleton,
) -> None:
    """docs/results/table1.md with its pictures and the figures as JSON."""
    first = next(iter(found.values()))[1]
    made_from, frames = first.made_from, len(first.joints)
    benchmark = replace(nyu_benchmark(), name=f"test set ({made_from})")
    chosen = list(nyu.EVALUATION_JOINTS)
    scores = {}
    for network, p, _ in found.values():
        scale = p.half_cube[:, None, None]
        errors = metrics.joint_errors(p.joints[:, chosen] * scale, p.truth[:, chosen] * scale)
        scores[network.title] = score_on(benchmark, errors)
    evaluate.plot(scores, benchmark, frames, args.out / "table1_joints.png")
    errors_deg = {n.title: angles.angle_errors(skeleton, inputs, truth) for n, _, inputs in found.values()}
    plot_angles(errors_deg, skeleton, args.out / "table1_angles.png")
    write_overlays(args.out / "table1_hands.jpg", found, skeleton)
    text = report(args, {name: n for name, (n, _, _) in found.items()}, results, made_from, frames)
    atomic.replace_text(args.out / "table1.md", text)
    figures = {"iterations": args.iterations, "seed": args.seed, "data": made_from, "frames": frames,
               "networks": {name: asdict(r) for name, r in results.items()}}  # fmt: skip
    atomic.replace_text(args.out / "table1.json", json.dumps(figures, indent=2) + "\n")
    print(text)


def report(
    args: argparse.Namespace, networks: dict[str, Network], results: dict[str, Result], made_from: str, frames: int
) -> str:
    """The page."""
    rows = [
        "| network | joint error, mm | angle error | out of limits | max ≤ 40 mm | angle error in the paper, NYU |",
        "|---|---|---|---|---|---|",
    ]
    for name, r in results.items():
        broken = "–" if r.out_of_limits is None else f"{r.out_of_limits:.1%}"
        rows.append(f"| {networks[name].title} | {r.error_14_mm:.2f} | {r.angle_deg:.2f}° | {broken} | "
                    f"{r.within_40_mm:.1%} | {networks[name].paper} |")  # fmt: skip
    comparable = (
        "The data are the paper's, so joint errors, angle errors and the order of the networks are comparable with its "
        "column, up to the number of iterations."
        if made_from == "NYU"
        else "The data are not the paper's, so its column tells the order to expect and not the size of the errors."
    )
    return "\n".join([
        "# Table 1: does a hand model in the network help?",
        "",
        f"Made by `python tools/table1.py --iterations {args.iterations} --seed {args.seed}` (`make table1`) on "
        f"data/nyu ({made_from}); every network with the paper's solver, batches of 512, one seed. Scored on "
        f"{frames} held-out frames.",
        "",
        *rows,
        "",
        "- Joint error: mean over the 14 joints compared on NYU, about the crop's centre (joint 34), cube 300 mm "
        "(261 mm for NYU's second subject).",
        "- Angle error: mean over the 23 free rotations, in canonical form, against the hand fitted to the annotated "
        f"joints (31 joints, within the limits, ridge {RIDGE:g}). Networks that predict joints get their angles by the "
        "same fit, without the ridge.",
        "- Out of limits: frames with any predicted angle beyond its limits. The paper: 18.6% without the physical "
        "constraint, 0.9% with it.",
        f"- {comparable}",
        "",
        "What the paper found, and what these trainings say:",
        "",
        *findings(results),
        "",
        "![Success curves and errors by joint](table1_joints.png)",
        "",
        "![Angle errors](table1_angles.png)",
        "",
        "Held-out frames, the annotated hand in white:",
        "",
        "![Hands](table1_hands.jpg)",
        "",
    ])  # fmt: skip


def findings(results: dict[str, Result]) -> list[str]:
    """The paper's conclusions (Sec. 4.1), each with what the figures here say."""
    if not set(results) >= {"ours", "no_limit", "direct_joint", "direct_parameter"}:
        return []
    ours, free = results["ours"], results["no_limit"]
    joint, parameter = results["direct_joint"], results["direct_parameter"]
    on_angles = max(ours.angle_deg, free.angle_deg, parameter.angle_deg)
    broken = (ours.out_of_limits or 0.0, free.out_of_limits or 0.0)
    claims = [
        ("ours is no worse than direct joint on joints", ours.error_14_mm <= joint.error_14_mm,
         f"{ours.error_14_mm:.2f} and {joint.error_14_mm:.2f} mm"),
        ("direct joint is better than direct parameter on joints", joint.error_14_mm < parameter.error_14_mm,
         f"{joint.error_14_mm:.2f} and {parameter.error_14_mm:.2f} mm"),
        ("direct joint is the worst of the four on angles", joint.angle_deg > on_angles,
         f"{joint.angle_deg:.2f}° and at most {on_angles:.2f}°"),
        ("PhysLimit keeps angles within their limits", broken[0] < broken[1] / 2,
         f"{broken[0]:.1%} and {broken[1]:.1%} of the frames out of limits"),
        ("at equal accuracy", abs(ours.error_14_mm - free.error_14_mm) < 1,
         f"{ours.error_14_mm:.2f} and {free.error_14_mm:.2f} mm"),
    ]  # fmt: skip
    return [f"- {claim}: {'confirmed' if true else 'not confirmed'}, {figures}" for claim, true, figures in claims]


def plot_angles(errors: dict[str, Array], skeleton: Skeleton, out: Path) -> None:
    """Frames by mean angle error, and the mean error of every rotation. Raises NetlibError."""
    figure = pictures.new_figure(12, 7.5)
    above, below = figure.subplots(2, 1)
    thresholds = np.arange(0, 61)
    rotations = [skeleton.dof_names[d] for d in angles.rotations(skeleton)]
    width = 0.8 / len(errors)
    for i, (title, e) in enumerate(errors.items()):
        colour = evaluate.COLOURS[i % len(evaluate.COLOURS)]
        above.plot(thresholds, 100 * metrics.success_rate(e, thresholds, worst=False), color=colour,
                   label=f"{title}: {e.mean():.2f}°")  # fmt: skip
        below.bar(np.arange(len(rotations)) - 0.4 + i * width, e.mean(axis=0), width, align="edge", color=colour)
    above.set(xlabel="threshold, degrees", ylabel="frames with mean angle error within, %", xlim=(0, 60), ylim=(0, 101))
    above.legend(frameon=False)
    below.set(ylabel="mean error, degrees")
    below.set_xticks(range(len(rotations)), [name.replace("_rot_", " ").replace("_", " ") for name in rotations],
                     rotation=60, ha="right")  # fmt: skip
    for axis in (above, below):
        axis.grid(True, axis="both" if axis is above else "y", alpha=0.3)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    pictures.write_figure(out, figure, dpi=110)


def write_overlays(
    out: Path, found: dict[str, tuple[Network, Predictions, Array]], skeleton: Skeleton, count: int = 4
) -> None:
    """Frames of middling error, a network a column. Raises NetlibError."""
    data = data_layer(Net(NETWORKS[0].model, netlib.TEST))
    depth = data.spec.top.index("depth")
    ours = found["ours"][1]
    order = np.argsort(np.linalg.norm(ours.joints - ours.truth, axis=2).mean(axis=1))
    chosen = order[(np.linspace(0.1, 0.9, count) * (len(order) - 1)).astype(int)]
    images, titles = [], []
    for n in chosen:
        crop = data.row(int(n))[depth][0]
        for network, p, _ in found.values():
            error = np.linalg.norm(p.joints[n] - p.truth[n], axis=1).mean() * p.half_cube[n]
            images.append(hands.overlay(crop, p.joints[n], skeleton, p.truth[n], zoom=2))
            titles.append(f"{network.title}, {error:.0f} mm")
    pictures.write_image(out, sheets.sheet(images, len(found), titles))


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
