"""Errors of a network and of the fit after it on synthetic hands: failures, confidence,
handedness, time.

    python -m experiments fit
    python -m experiments fit --network snapshots/x.caffemodel.h5 prototxt/nyu_deploy.prototxt
    python -m experiments fit --recipes nyu cameras --frames 512 --hands

The default is the packaged network models/synthetic_hand. Frames are drawn from recipes (listed by
tools/make_synthetic.py --help) with a split and seed that were not used for tuning. Errors are
means over NYU's 14 joints in mm. A frame has failed if its error is above 30 mm; "auc" measures how
well the expected error predicts failures; "expected" is its mean; "right" is the fraction of frames
whose fit costs less than that of their mirror image (--hands); "ms" is the time per frame in
blocks of 64, with network and crop.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.choices import add_choices
from experiments.tables import figure, tabulated
from handpose.body.sides import SIDES, Side
from handpose.estimate.candidates import Candidate
from handpose.estimate.crop_fits import fit_starts
from handpose.estimate.estimator import HandEstimator
from handpose.estimate.nets import refuse_other_bodies, skeleton_to_fit
from handpose.estimate.packaged import SYNTHETIC_HAND, checked_content, read_card
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.pose_confidence import GOOD_MM
from handpose.fit.settings import PLANS, FitSettings, Plan
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic import recipes
from handpose.synthetic.generator import BLOCK, Generator, Scene
from netlib.blob import Array, divide_up
from netlib.net import Net
from netlib.training.trained import trained
from tools.common.arguments import add_engine, count, seed
from tools.common.console import say
from tools.common.progress import ProgressBar


class FitFigures(NamedTuple):
    """The fits of N frames by one plan.

    error       (N,) mean error in mm over NYU's 14 joints
    expected    (N,) the error that is expected
    confidence  (N,)
    right       (N,) 1 if a frame's fit costs less than its mirror image's, else 0; NaN if not
                requested
    seconds     (N,) time of a frame
    """

    error: Array
    expected: Array
    confidence: Array
    right: Array
    seconds: Array


class Figures(NamedTuple):
    """The results for N frames.

    network  (N,) mean error in mm over NYU's 14 joints of the network alone
    limbs    (N, L) errors of the limbs' inputs of the network
    poses    (N, L) the limbs' inputs themselves
    fits     by the names of the plans
    """

    network: Array
    limbs: Array
    poses: Array
    fits: dict[str, FitFigures]


def scenes_of(generator: Generator, frames: int) -> Iterator[Scene]:
    """The first frames of a generator, at least this many, in blocks."""
    return map(generator.scene, range(divide_up(frames, BLOCK)))


def measure(
    net: Net,
    fitter_of: Callable[[float], DepthFitter],
    scenes: Iterable[Scene],
    plans: Sequence[Plan],
    *,
    hands: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> Figures:
    """Fit frames by several plans, with the fitter for the unit of their crops.

    Raises NetlibError.

    fitter_of  the fitter for a unit in mm, half the edge of a crop's cube
    hands      fit their mirror images, too
    progress   called with the number of further frames done
    """
    fitter_of = functools.cache(fitter_of)
    of_network: list[tuple[Array, Array, Array]] = []
    of_plans: dict[str, list[FitFigures]] = {plan.name: [] for plan in plans}
    for scene in scenes:
        unit_mm = scene.cube_mm / 2
        fitter = fitter_of(unit_mm)
        model = fitter.model
        joints = scene.bodies.joints * unit_mm
        (x,) = fit_starts(net, fitter, scene.depth, (0,))
        true = model.variables_of(scene.bodies.inputs)
        errors_mm = mean_errors_14(model.joints(x), joints)
        of_network.append((errors_mm, (x - true)[:, model.limbs], true[:, model.limbs]))
        for plan in plans:
            of_plans[plan.name].append(_fit(net, fitter, scene, joints, plan, hands))
        progress(len(joints))
    network, errors, poses = map(np.concatenate, zip(*of_network))
    fits = {plan: FitFigures(*map(np.concatenate, zip(*parts))) for plan, parts in of_plans.items()}
    return Figures(network, errors, poses, fits)


def _fit(
    net: Net, fitter: DepthFitter, scene: Scene, joints: Array, plan: Plan, hands: bool
) -> FitFigures:
    """The fits of a block with joints (N, K, 3) in mm; of mirror images, too, if ``hands``."""
    estimator = HandEstimator(net, scene.cube_mm, fitter=fitter)

    def candidates(side: Side) -> list[Candidate]:
        crops = zip(scene.center_uvd, scene.depth)
        return [Candidate.of_side(side, crop, center, scene.camera) for center, crop in crops]

    right, left = map(candidates, SIDES)
    N = len(joints)
    begun = time.perf_counter()
    found = estimator.estimate(right, scene.camera, plan)
    seconds = np.full(N, (time.perf_counter() - begun) / N)
    is_right = np.full(N, np.nan)
    if hands:
        mirrored = estimator.estimate(left, scene.camera, plan)
        is_right[:] = [hand.cost < image.cost for hand, image in zip(found, mirrored)]
    expected, confidence = np.transpose([(hand.error_mm, hand.confidence) for hand in found])
    errors = mean_errors_14(np.stack([hand.joints_mm for hand in found]), joints)
    return FitFigures(errors, expected, confidence, is_right, seconds)


def auc(score: Array, failed: NDArray[np.bool_]) -> float:
    """The chance that a failed frame has a higher score than another (area under the ROC curve);
    NaN without both.
    """
    from scipy.stats import mannwhitneyu  # imported here: it takes a second

    bad, good = score[failed], score[~failed]
    if not len(bad) or not len(good):
        return float("nan")
    # the pairs of a failed frame and another in which the failed one has the higher score
    higher = mannwhitneyu(bad, good).statistic
    return float(higher / (len(bad) * len(good)))


# ------------------------------------------------------------------------------------- command line


def add_network(parser: argparse.ArgumentParser) -> None:
    """Add the option of another network than the packaged one."""
    parser.add_argument(
        "--network",
        nargs=2,
        type=Path,
        metavar=("WEIGHTS", "NET"),
        help="*.caffemodel.h5, and the deploy prototxt of their net",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_network(parser)
    add_choices(parser, "--recipes", recipes.NAMES, recipes.NAMES[:3])
    add_choices(parser, "--plans", PLANS)
    parser.add_argument(
        "--frames",
        type=count,
        default=2000,
        metavar="N",
        help="per recipe, rounded up to a multiple of 64 (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="seed of the frames (default: 0)"
    )
    parser.add_argument(
        "--hands", action="store_true", help="also fit mirror images (twice the time)"
    )
    add_engine(parser)


def run(args: argparse.Namespace) -> None:
    """Measure the network and the fits. Raises NetlibError."""
    weights, model = args.network or (
        checked_content(read_card(SYNTHETIC_HAND)),
        SYNTHETIC_HAND / "deploy.prototxt",
    )
    net = trained(model, weights, args.engine)
    skeleton = skeleton_to_fit(net)
    refuse_other_bodies(skeleton, "the recipes are of hands")
    fitter_of = functools.partial(DepthFitter.of_file, skeleton, weights)
    plans = [FitSettings().search.plans[name] for name in args.plans]
    rows = []
    with ProgressBar(args.frames * len(args.recipes)) as progress:
        for recipe in args.recipes:
            scenes = scenes_of(Generator(args.seed, "test", recipes.recipe(recipe)), args.frames)
            figures = measure(net, fitter_of, scenes, plans, hands=args.hands, progress=progress)
            rows.append({"recipe": recipe, "plan": "network", **_error_cells(figures.network)})
            rows += [
                {"recipe": recipe, "plan": plan, **_error_cells(fit.error), **_fit_cells(fit)}
                for plan, fit in figures.fits.items()
            ]
    say(f"{len(figures.network)} frames per recipe, seed {args.seed}; mm, 14 joints")
    print(tabulated(rows))


def _error_cells(errors: Array) -> dict[str, str]:
    """The columns of a network and of a fit."""
    return {
        "mean": f"{errors.mean():.2f}",
        "median": f"{np.median(errors):.2f}",
        "failed": f"{(errors > GOOD_MM).mean():.1%}",
    }


def _fit_cells(fit: FitFigures) -> dict[str, str]:
    """The columns of a fit only; empty where there is no value."""
    return {
        "auc": figure("{:.3f}", auc(fit.expected, fit.error > GOOD_MM)),
        "expected": figure("{:.2f}", fit.expected.mean()),
        "confidence": figure("{:.1%}", fit.confidence.mean()),
        "right": figure("{:.1%}", fit.right.mean()),
        "ms": f"{1000 * fit.seconds.mean():.1f}",
    }
