"""One row of the paper's Table 1: derive a network, train it, and score it on the
setting's test frames.

    python -m experiments table1 ours
    python -m experiments table1 direct_joint --recipe paper --iterations 13500 --seed 2
    python -m experiments table1 ours --limit-weight 10 --limit-norm L2
    python -m experiments table1 ours_bones --setting many_hands

docs/results/table1.md has the rows of all networks and the meaning of the columns. A setting is a
data set, by default in data/SETTING: "one_hand" (test: the same hand, and a second, smaller one, as
in NYU), "many_hands" (hands of many people in the same poses) and "nyu" (NYU itself, prepared by
tools/prepare_nyu.py). The synthetic ones take 5 GB each:

    python tools/make_synthetic.py --recipe one_hand --out data/one_hand --train 72757 --test 4096

Recipes: "adam" (synthetic_solver.prototxt, SmoothL1Loss, no dropout) has a constant rate, then
linearly to 0 over the last 30% of the iterations; "paper" (nyu_solver.prototxt) a tenth of the rate
for the last 10%. The first run of a setting fits the hand to its joints, in a folder next to the
data. Ctrl-C writes a snapshot, from which the same command continues.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from experiments.table1_nets import NETWORKS, RECIPES, Recipe, derived_net, set_limit, solvers
from experiments.tables import tabulated
from handpose.body import nyu
from handpose.fit.joints import angles, companions
from handpose.fit.joints.fit_joints import fit_joints
from handpose.scoring import metrics
from handpose.scoring.held_out import Predictions, figures_of, predict_all
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.files import atomic, hdf5, make_folder
from netlib.proto.prototxt import Message
from netlib.training.trained import trained
from tools.common import training
from tools.common.arguments import seed, weight, whole, workers
from tools.common.console import DONE, say
from tools.common.progress import ProgressBar

STATE, WEIGHTS = ".solverstate.h5", ".caffemodel.h5"
BOTTLENECK = 30  # components
RIDGE = 3e-4  # of the fit to all joints; sufficient, because 31 joints determine nearly all angles
# networks that learn the fitted angles, and the exact ones
FITTED, EXACT = "direct_parameter", "direct_parameter_exact"
SETTINGS = ("one_hand", "many_hands", "nyu")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("network", choices=NETWORKS, metavar="NETWORK", help=", ".join(NETWORKS))
    parser.add_argument(
        "--setting", choices=SETTINGS, default="one_hand", help="default: %(default)s"
    )
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="folder of the setting's data sets"
    )
    parser.add_argument("--recipe", choices=RECIPES, default="adam", help="default: %(default)s")
    parser.add_argument(
        "--iterations", type=whole(2), metavar="N", help="default: 30000, with --recipe paper 10000"
    )
    parser.add_argument("--seed", type=seed, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--limit-weight", type=weight, default=1.0, metavar="W", help="of PhysLimit (default: 1)"
    )
    parser.add_argument(
        "--limit-norm", choices=("L1", "L2"), default="L1", help="of PhysLimit (default: L1)"
    )
    parser.add_argument(
        "--threads", type=workers, metavar="N", help="training threads (default: one per processor)"
    )
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("snapshots/table1"),
        metavar="FOLDER",
        help="folder of nets, snapshots and logs (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Train the network, score it, and print its row. Raises NetlibError."""
    if args.setting == "nyu" and args.network == EXACT:
        raise NetlibError(
            f"{args.network}: the exact angles of NYU's frames are unknown; expected a synthetic setting"
        )
    data = args.data or Path("data") / args.setting
    lists = {split: data / f"{split}.txt" for split in ("train", "test")}
    files = {split: _files(path, args.setting) for split, path in lists.items()}
    skeleton = skeletons.load()
    fitted = _fitted_angles(files["test"], lists["test"], skeleton)
    if args.network == FITTED:
        _fitted_angles(files["train"], lists["train"], skeleton)
        lists = {split: _companions(path) / path.name for split, path in lists.items()}
    recipe = RECIPES[args.recipe]
    length = args.iterations or recipe.length
    prefix = _prefix(args, length)
    net = _net(args, recipe, lists)
    components = files["train"] if args.network == "bottleneck" else ()
    status = train(prefix, net, recipe, length, args.seed, args.threads, components)
    if status != DONE:
        return status
    predictions = predict_all(trained(f"{prefix}_net.prototxt", f"{prefix}_iter_{length}{WEIGHTS}"))
    found = _scores_of(predictions, args.setting, files["test"], fitted, skeleton)
    say(
        f"{len(predictions.joints)} test frames of {data} ({predictions.made_from}); errors in mm of 14 joints"
    )
    print(tabulated([_names(args, length) | found]))
    return DONE


def _prefix(args: argparse.Namespace, length: int) -> Path:
    """The beginning of the paths of a run's files."""
    network = args.network + _limit_name(args)
    return args.work / f"{args.setting}_{network}_{args.recipe}_{length}_seed{args.seed}"


def _net(args: argparse.Namespace, recipe: Recipe, lists: dict[str, Path]) -> Message:
    """The net with the recipe's changes and the user's PhysLimit. Raises NetlibError."""
    net = derived_net(args.network, recipe, lists)
    if _limit_name(args):
        set_limit(net, args.limit_weight, args.limit_norm)
    return net


def _names(args: argparse.Namespace, length: int) -> dict[str, str]:
    """The columns of a row that say which run it is."""
    return {
        "network": args.network + _limit_name(args),
        "recipe": args.recipe,
        "iterations": str(length),
        "seed": str(args.seed),
    }


def _limit_name(args: argparse.Namespace) -> str:
    """The end of a network's name with another PhysLimit than the paper's, otherwise empty."""
    if (args.limit_weight, args.limit_norm) == (1, "L1"):
        return ""
    return f"_{args.limit_norm}_{args.limit_weight:g}"


def _files(path: Path, setting: str) -> list[Path]:
    """The files in a list of a setting. Raises DataError with the command that makes them."""
    try:
        return hdf5.read_list(str(path), None)
    except DataError as error:
        how = "prepare_nyu.py NYU_ROOT"
        if setting != "nyu":
            how = f"make_synthetic.py --recipe {setting} --out {path.parent} --train {nyu.TRAIN_FRAMES} --test 4096"
        raise DataError(f"{error}; make it with 'python tools/{how}'") from None


def _companions(path: Path) -> Path:
    """The folder of the fitted angles for the data of a list."""
    return path.parent.with_name(f"{path.parent.name}_angles")


def _fitted_angles(files: Sequence[Path], path: Path, skeleton: Skeleton) -> Array:
    """The inputs (N, D) of the hand fitted to all joints, from files next to the data.

    Raises DataError.
    """
    rows = sum(hdf5.File(file, ("joint",)).rows for file in files)
    with ProgressBar(rows, what=f"angles of {path.stem}") as progress:
        return companions.fit_list(
            files, _companions(path), path.name, skeleton, ridge=RIDGE, progress=progress
        )[0]


# ----------------------------------------------------------------------------------------- training


def write_components(path: Path, files: Sequence[Path]) -> None:
    """Write weights of DeepPrior's layer "joints": mean and largest principal components of the
    joints in the files.

    Components are scaled by their standard deviation, so the numbers of the bottleneck have about
    unit size (Oberweger et al. 2015, Sec. 3.2). Raises DataError.
    """
    joints = column(files, "joint", 3 * len(nyu.ANNOTATION_OF_JOINT))
    mean = joints.mean(axis=0)
    values, vectors = np.linalg.eigh(joints.T @ joints / len(joints) - np.outer(mean, mean))
    largest = np.s_[: -BOTTLENECK - 1 : -1]  # eigh sorts in ascending order
    scaled = vectors[:, largest] * np.sqrt(np.maximum(values[largest], 0))
    with hdf5.created(path) as file:
        file["data/joints/0"] = scaled.astype(np.float32)
        file["data/joints/1"] = mean.astype(np.float32)


def train(
    prefix: Path,
    net: Message,
    recipe: Recipe,
    length: int,
    seed: int,
    threads: int | None,
    components: Sequence[Path],
) -> int:
    """Train to the end, from the newest snapshot if there is one; returns the exit status.

    prefix      of the files: net, solver, log, snapshots
    components  files of joints whose principal components the bottleneck starts from; else empty

    Raises NetlibError, also if there are snapshots of another net.
    """
    model = Path(f"{prefix}_net.prototxt")
    make_folder(prefix.parent)
    if _newest(prefix) and atomic.text_of(model) != str(net):
        raise NetlibError(
            f"{model}: its snapshots are of another net; remove them, or choose another --work"
        )
    atomic.replace_text(model, str(net))
    first: list[Path] = []
    if components:
        first = [Path(f"{prefix}_components{WEIGHTS}")]
        write_components(first[0], components)
    own = {
        "net": model,
        "display": 100,
        "snapshot": 5000,
        "snapshot_format": "HDF5",
        "snapshot_prefix": prefix,
        "random_seed": seed,
    }
    for last, tree in solvers(recipe, length, own):
        state = _newest(prefix)
        if state is not None and _iteration(state) >= last:
            continue
        solver = Path(f"{prefix}_solver.prototxt")
        atomic.replace_text(solver, str(tree))
        status = training.train(
            solver,
            snapshot=state,
            weights=() if state else first,
            threads=threads,
            log_file=f"{prefix}.log",
        )
        if status != DONE:
            return status
    return DONE


def _newest(prefix: Path) -> Path | None:
    """The solver state of the last iteration among the snapshots of a run; None without any."""
    states = [
        path
        for path in prefix.parent.glob(f"*{STATE}")
        if path.name.startswith(f"{prefix.name}_iter_")
    ]
    return max(states, key=_iteration, default=None)


def _iteration(state: Path) -> int:
    return int(state.name.removesuffix(STATE).rpartition("_")[2])


# ------------------------------------------------------------------------------------------- scores


def angles_of(
    predictions: Predictions, skeleton: Skeleton, progress: Callable[[int], None]
) -> Array:
    """Inputs (N, D) of the hand that a network predicts: its own, or fitted within the limits
    to its joints.
    """
    if predictions.dof is not None:
        return np.where(skeleton.fixed, 0.0, predictions.dof.astype(np.float64))
    return fit_joints(
        skeleton, predictions.joints.astype(np.float64), limits=True, starts=4, progress=progress
    ).inputs


def _scores_of(
    predictions: Predictions, setting: str, files: Sequence[Path], fitted: Array, skeleton: Skeleton
) -> dict[str, str]:
    """The scores of the predictions for the test files of a setting."""
    exact = None if setting == "nyu" else column(files, "dof", len(skeleton.initial))
    has_people = setting == "many_hands"
    bones = column(files, "bones", len(skeleton.bones)) if has_people else None
    with ProgressBar(len(predictions.joints), what="angles") as progress:
        inputs = angles_of(predictions, skeleton, progress)
    return scores(predictions, inputs, fitted, exact, bones, skeleton)


def scores(
    predictions: Predictions,
    inputs: Array,
    fitted: Array,
    exact: Array | None,
    bones: Array | None,
    skeleton: Skeleton,
) -> dict[str, str]:
    """The columns of a row, as text; a dash where a score does not exist.

    inputs  (N, D) of ``angles_of``
    fitted  (N, D) inputs of the hand fitted to the true joints
    exact   (N, D) inputs that posed the frames; None for real ones
    bones   (N, K) signed lengths of the bones in half-cubes; None if all have the skeleton's
    """
    figures = figures_of(predictions, skeleton)
    row = _joint_errors(predictions)
    for name, truth in (("fitted angles", fitted), ("exact angles", exact)):
        row[name] = "–"
        if truth is not None:
            row[name] = f"{angles.angle_errors(skeleton, inputs, truth).mean():.2f}°"
    row["out of limits"] = f"{figures['out_of_limits']:.1%}" if "out_of_limits" in figures else "–"
    row["max <= 40"] = f"{figures['within_40_mm']:.1%}"
    if bones is not None and predictions.dof is not None:
        size = np.abs(bones).sum(axis=1, keepdims=True) / np.abs(skeleton.bones).sum()
        hand = kinematics_of(skeleton)
        for name, own in (("scaled hand", skeleton.bones * size), ("person's bones", bones)):
            row[name] = f"{_errors_of(predictions, hand.joints(inputs, own)).mean():.2f}"
    return row


def _errors_of(predictions: Predictions, joints: Array) -> Array:
    """The mean errors (N,) in mm of joints (N, K, 3) in half-cubes, over the 14 joints."""
    scale = predictions.half_cube[:, None, None]
    return metrics.mean_errors_14(joints * scale, predictions.truth * scale)


def _joint_errors(predictions: Predictions) -> dict[str, str]:
    """The columns of the error: of all frames, and of each cube if there are two."""
    errors = _errors_of(predictions, predictions.joints)
    row = {"error": f"{errors.mean():.2f}"}
    edges = np.round(2 * predictions.half_cube)
    cubes = np.unique(edges)
    if len(cubes) == 2:
        for edge in cubes[::-1]:
            row[f"cube of {edge:.0f}"] = f"{errors[edges == edge].mean():.2f}"
    return row


def column(files: Sequence[Path], name: str, width: int) -> Array:
    """The rows (N, width) of a data set, of all files. Raises DataError."""
    parts = [hdf5.File(path, (name,)).datasets[0].numbers() for path in files]
    for path, part in zip(files, parts):
        if part.shape[1:] != (width,) or not np.isfinite(part).all():
            raise DataError(
                f"{path}: data set {name!r} has shape {part.shape}, expected (N, {width}) finite numbers"
            )
    return np.concatenate(parts)
