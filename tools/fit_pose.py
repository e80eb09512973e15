#!/usr/bin/env python3
r"""Fit the hand model to annotated or predicted joints, to obtain its angles.

    python tools/fit_pose.py nyu_test_groundtruth_label.txt --out truth.h5
    python tools/fit_pose.py data/nyu/train.txt --out data/nyu_angles

The first command reads a text file with one frame per line, NYU's 14 joints (u v d in px, px, mm;
with --format xyz in mm), and writes dof (N, 47) and residual_mm (N, 14). The second reads a list of
HDF5 files. For each it writes a small file with the angles and links to the data, and finally a
list of these files: a training set with angles as labels. Files that exist are kept; other files
are never replaced.

The fit uses Levenberg-Marquardt from several starts; --swarm uses the paper's particle swarm, which
is slower and less accurate.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from handpose import NYU
from handpose.body import nyu
from handpose.datasets.frames import spread
from handpose.fit.joints.companions import fit_list, write_fit
from handpose.fit.joints.fit_joints import fit_absolute, fit_joints
from handpose.fit.joints.particle_swarm import fit_joints_by_swarm
from handpose.scoring import metrics
from handpose.scoring.published_predictions import COORDINATE_FORMATS, is_list, read_joints
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.errors import DataError, NetlibError, reason_of
from netlib.files.hdf5 import File, read_list
from tools.common import outputs
from tools.common.arguments import count, parser_of, real, reject_given
from tools.common.console import duration, guarded, notify, say
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "joints", metavar="FILE", help="a text file of joints, or a list of HDF5 files"
    )
    parser.add_argument(
        "--out", metavar="PATH", help="file to write for a text file of joints, folder for a list"
    )
    parser.add_argument(
        "--format",
        choices=COORDINATE_FORMATS,
        default="uvd",
        help="of a text file (default: %(default)s)",
    )
    parser.add_argument(
        "--skeleton", metavar="FILE", help="skeleton file of the hand (default: NYU's)"
    )
    parser.add_argument(
        "--no-limits", action="store_true", help="allow angles outside their limits"
    )
    parser.add_argument(
        "--ridge",
        type=real(0),
        default=0.0,
        metavar="W",
        help="weight of squared angles, which favours the initial pose (default: %(default)g)",
    )
    parser.add_argument("--swarm", action="store_true", help="particle swarm, as in the paper")
    parser.add_argument(
        "--particles", type=count, default=128, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--generations", type=count, default=200, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--frames", type=count, metavar="N", help="fit only N evenly spaced frames (text files)"
    )
    args = parser.parse_args(argv)
    if args.swarm and (args.no_limits or args.ridge):
        parser.error("--swarm does not support --no-limits and --ridge")
    if not args.swarm:
        reject_given(parser, args, ["particles", "generations"], "applies only with --swarm")
    return guarded(run, args)


def run(args: argparse.Namespace) -> None:
    """Fit the joints."""
    skeleton = skeletons.load(args.skeleton) if args.skeleton else skeletons.load()
    begun = time.perf_counter()
    fit = _fit_list if is_list(args.joints) else _fit_text
    inputs, residuals = fit(args, skeleton)
    frame = np.nanmean(residuals, axis=1)
    broken = metrics.fraction_out_of_limits(
        inputs, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=1e-6
    )
    seconds = time.perf_counter() - begun
    say(
        f"{len(frame)} frames in {duration(seconds)}: residual {np.nanmean(residuals):.4f} mm "
        f"(mean over joints), {np.median(frame):.4f} median frame, {frame.max():.4f} worst frame; "
        f"{broken:.2%} of the frames have an angle outside its limits"
    )


def _fit_text(args: argparse.Namespace, skeleton: Skeleton) -> tuple[Any, Any]:
    """Inputs (N, D) and residuals (N, K) in mm for the frames of a text file; written if
    --out is given.
    """
    chosen = nyu.EVALUATION_JOINTS
    if max(chosen) >= len(skeleton.parents):
        raise DataError(
            f"skeleton {skeleton.name!r} has {len(skeleton.parents)} joints, expected the 31 of NYU's hand"
        )
    if args.out:
        outputs.refuse_inputs(args.out, [args.joints, args.skeleton])
    xyz = read_joints(args.joints, len(chosen), args.format, NYU)
    rows = spread(len(xyz), args.frames) if args.frames else np.arange(len(xyz))
    half_cube = nyu.half_cubes(len(xyz))[rows]
    with ProgressBar(len(rows)) as progress:
        found, center = fit_absolute(
            skeleton, xyz[rows], half_cube, chosen, progress=progress, **_method(args)
        )
    if args.out:
        try:
            write_fit(Path(args.out), found, center, half_cube, rows)
        except OSError as error:
            raise NetlibError(f"{args.out}: {reason_of(error)}") from None
    if warning := nyu.one_size_for_all(len(xyz)):
        notify(warning)
    return found.inputs, found.residuals


def _method(args: argparse.Namespace) -> dict[str, Any]:
    """The arguments of ``fit_absolute`` for the fit and its options."""
    if args.swarm:
        own = {"particles": args.particles, "generations": args.generations}
        return {"fit": fit_joints_by_swarm, **own}
    return {"fit": fit_joints, "limits": not args.no_limits, "ridge": args.ridge}


def _fit_list(args: argparse.Namespace, skeleton: Skeleton) -> tuple[Any, Any]:
    """Inputs (N, D) and residuals (N, K) in mm for the frames of a list, written to files with
    links to the data.
    """
    if args.swarm or args.frames or args.format != "uvd":
        raise NetlibError(
            f"{args.joints}: a list of HDF5 files; --swarm, --frames and --format need a text file "
            "of joints"
        )
    if not args.out:
        raise NetlibError(
            f"{args.joints}: a list of HDF5 files needs --out FOLDER for their angles"
        )
    name = Path(args.joints).name
    outputs.refuse_inputs(Path(args.out) / name, [args.joints])
    files = read_list(args.joints, None)
    with ProgressBar(sum(File(file, ("joint",)).rows for file in files)) as progress:
        return fit_list(
            files,
            Path(args.out),
            name,
            skeleton,
            progress=progress,
            limits=not args.no_limits,
            ridge=args.ridge,
        )


if __name__ == "__main__":
    sys.exit(main())
