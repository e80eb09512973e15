"""Detection in synthetic scenes with forearms in front, bodies behind, and tables and bottles next to the hand.

    python -m experiments finding
    python -m experiments finding --scenes 30 --fit fast

Runs the packaged weights on full depth images of handpose.synthetic.scenes, with a seed that was not used for tuning. A
hand is "found" if its palm is within 30 mm of the true one, "right" if it is reported as a right hand, which all are;
"located" is the median distance of the locator's best candidate from the hand's centre; "mean" and "median" refer to
the error of 14 joints.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from handpose import NYU, load_predictor
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic.scenes import KINDS, draw_scenes
from netlib.blob import Array
from netlib.errors import DataError
from tools.common.arguments import add_engine, count, seed
from tools.common.console import DONE, aligned, say
from tools.common.progress import ProgressBar

FOUND_MM = 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--scenes", type=count, default=150, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of the scenes (default: 0)")
    parser.add_argument("--fit", choices=("fast", "accurate"), default="accurate", help="default: %(default)s")
    add_engine(parser)


def run(args: argparse.Namespace) -> int:
    """Measure detection. Raises NetlibError."""
    predictor = load_predictor(NYU, fit=args.fit, engine=args.engine, min_confidence=0)
    assert predictor.locator is not None
    palm = predictor.skeleton.joint_names.index("palm")
    rng, kinds, figures, seconds = np.random.default_rng(args.seed), [], [], 0.0
    with ProgressBar(args.scenes) as progress:
        for number in range(args.scenes):
            scene = draw_scenes(rng, 1, first=number)
            depth, center, joints = scene.depth[0], scene.center[0], scene.joints[0]
            kinds.append(scene.kind[0])
            progress(1)
            begun = time.perf_counter()
            try:
                found = predictor.in_frame(depth)
            except DataError:  # no hand was found
                figures.append((False, False, np.nan, np.nan))
                continue
            finally:
                seconds += time.perf_counter() - begun
            located = predictor.locator.hands(depth, NYU).center[0]
            off = float(np.linalg.norm(found.xyz[palm] - joints[palm]))
            error = float(mean_errors_14(found.xyz[None], joints[None])[0])
            figures.append((off < FOUND_MM, found.hand == "right", float(np.linalg.norm(located - center)), error))
    table = np.array(figures, dtype=float)
    groups = {kind: table[np.array(kinds) == kind] for kind in KINDS if kind in kinds} | {"all": table}
    say(f"{args.scenes} scenes, seed {args.seed}, {args.fit} fit, {1000 * seconds / args.scenes:.0f} ms each; mm")
    print(aligned([["scenes", "count", "found", "right", "located", "mean", "median"],
                   *([kind, *_summary(group)] for kind, group in groups.items())]))
    return DONE


def _summary(table: Array) -> list[str]:
    """Number of scenes (n, 4), fractions found and reported as right hands, and errors of those with an answer."""
    found, right, located, error = table.T
    answered = ~np.isnan(error)
    rates = [str(len(table)), f"{found.mean():.1%}", f"{right.mean():.1%}"]
    if not answered.any():
        return [*rates, "", "", ""]
    errors = (np.median(located[answered]), error[answered].mean(), np.median(error[answered]))
    return [*rates, *(f"{value:.1f}" for value in errors)]
