#!/usr/bin/env python3
"""Time the fit to depth on one core, for single frames and batches, including network and crop.

    python benchmarks/fit.py

Prints medians over frames of the recipe nyu, with the packaged weights, on one thread.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from handpose import NYU, load_predictor
from handpose.estimate.estimator import MAX_CROPS, fit_crops
from handpose.estimate.nets import hand_poses
from handpose.fit.observation import HandCrops
from handpose.fit.search import PLANS
from handpose.synthetic.generator import Generator
from netlib import engine
from tools.common.arguments import parser_of, positive
from tools.common.console import DONE, aligned, guarded


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeats", type=positive, default=40, metavar="N", help="default: %(default)s")
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Time every plan and print a table; returns the exit status."""
    engine.get().set_threads(1)
    generator = Generator(3, "test")
    scenes = [generator.scene(number) for number in range(2)]
    crops = np.concatenate([scene.depth for scene in scenes])[:MAX_CROPS]
    uvd = np.concatenate([scene.center_uvd for scene in scenes])[:MAX_CROPS]
    rows = [["ms a frame", "network", "observation", "all, single", f"all, {len(crops)} together"]]
    hands = HandCrops.of_sides(crops, uvd, NYU, 300.0)
    for plan in PLANS.values():
        predictor = load_predictor(fit=plan.name, hand="right")
        net, fitter = predictor.net, predictor.fitter
        assert fitter is not None
        one = itertools.cycle(range(len(crops)))

        def single(work: Callable[[slice], object], one=one) -> float:  # type: ignore[no-untyped-def]
            return _median(lambda: work(slice(n := next(one), n + 1)), args.repeats)

        turned = np.stack([np.rot90(crops[0], quarter) for quarter in plan.quarters])
        rows.append([
            plan.name,
            f"{_median(lambda turned=turned, net=net: hand_poses(net, turned), args.repeats):.1f}",  # type: ignore[misc]
            f"{single(lambda r, p=plan: hands.take(r).observe(p.points)):.1f}",  # type: ignore[misc]
            f"{single(lambda r, net=net, f=fitter, p=plan: fit_crops(net, f, hands.take(r), p)):.1f}",  # type: ignore[misc]
            f"{_median(lambda net=net, f=fitter, p=plan: fit_crops(net, f, hands, p), 3) / len(crops):.1f}",  # type: ignore[misc]
        ])
    print(aligned(rows))
    return DONE


def _median(work: Callable[[], object], repeats: int) -> float:
    """Return the median time in ms, after one warm-up run."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) * 1000


if __name__ == "__main__":
    sys.exit(main())
