#!/usr/bin/env python3
r"""Fit the hand model to joints: which angles put its joints where they were annotated, or predicted?

    python tools/fit_pose.py test_groundtruth_uvd.txt --out truth.h5
    python tools/fit_pose.py data/nyu/train.txt --out data/nyu_angles

The first reads a text file of NYU's 14 joints (u v d in px, px, mm on every line, or with --format xyz mm), and writes
dof (N, 47) and residual_mm (N, 14). The second reads a list of HDF5 files and writes, for each of them, a small file
with the angles beside links to its data, and the list: a training set with angles as labels. Files that are there
already are kept.

Levenberg-Marquardt from several starts; --swarm is the paper's particle swarm, slower and worse.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels

# isort: split

import h5py
import numpy as np

from handpose.data import parts
from handpose.facts import nyu
from handpose.facts.cameras import NYU
from handpose.fitting import companions
from handpose.fitting.levenberg_marquardt import fit_joints
from handpose.fitting.particle_swarm import fit_joints_by_swarm
from handpose.scoring import metrics
from handpose.scoring.published_predictions import FORMATS, read_joints
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib import atomic
from netlib.errors import DataError, NetlibError, reason_of
from netlib.hdf5 import read_list
from tools.console import DONE, duration, guarded, positive, progress_bar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("joints", metavar="FILE", help="a text file of joints, or a list of HDF5 files")
    parser.add_argument("--out", metavar="PATH", help="file for a text file of joints, folder for a list")
    parser.add_argument("--format", choices=FORMATS, default="uvd", help="of a text file (default: %(default)s)")
    parser.add_argument("--skeleton", metavar="FILE", help="the hand (default: NYU's)")
    parser.add_argument("--no-limits", action="store_true", help="let angles leave their limits")
    parser.add_argument("--ridge", type=_weight, default=0.0, metavar="W",
                        help="pull to the initial pose: weight of squared angles (default: 0)")  # fmt: skip
    parser.add_argument("--starts", type=positive, default=8, metavar="N", help="for each frame (default: %(default)s)")
    parser.add_argument("--swarm", action="store_true", help="particle swarm, as the paper did")
    parser.add_argument("--particles", type=positive, default=128, metavar="N", help="default: %(default)s")
    parser.add_argument("--generations", type=positive, default=200, metavar="N", help="default: %(default)s")
    parser.add_argument("--frames", type=positive, metavar="N", help="only so many, spread evenly (text files)")
    args = parser.parse_args(argv)
    if args.swarm and (args.no_limits or args.ridge):
        parser.error("--swarm keeps to the limits and has no ridge")
    return guarded(lambda: run(args))


def _weight(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 <= number < np.inf:
        raise argparse.ArgumentTypeError(f"expected a number of at least 0, found {text!r}")
    return number


def run(args: argparse.Namespace) -> int:
    """Fit as the parsed arguments say."""
    skeleton = skeletons.load(args.skeleton) if args.skeleton else skeletons.load()
    begun = time.perf_counter()
    if _is_list(args.joints):
        if args.swarm or args.frames:
            raise NetlibError(f"{args.joints}: a list of HDF5 files; --swarm and --frames are for text files of joints")
        residuals, broken = _fit_list(args, skeleton)
    else:
        residuals, broken = _fit_text(args, skeleton)
    frame = np.nanmean(residuals, axis=1)
    print(
        f"{len(frame)} frames in {duration(time.perf_counter() - begun)}: residual {np.nanmean(residuals):.4f} mm "
        f"(mean over joints), {np.median(frame):.4f} median frame, {frame.max():.4f} worst frame; "
        f"{broken:.2%} of the frames have an angle out of its limits"
    )
    return DONE


def _is_list(path: str) -> bool:
    """Does the first line name a file? Else it starts with a number."""
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            first = file.readline().split()
    except OSError:
        return False  # the reader of text files says what is wrong
    try:
        [float(word) for word in first[:1]]
    except ValueError:
        return True
    return False


def _fit_text(args: argparse.Namespace, skeleton: Skeleton) -> tuple[Any, float]:
    chosen = list(nyu.EVALUATION_JOINTS)
    if max(chosen) >= len(skeleton.parents):
        raise DataError(f"skeleton {skeleton.name!r} has {len(skeleton.parents)} joints, expected the 31 of NYU's hand")
    xyz = read_joints(args.joints, len(chosen), args.format, NYU)
    rows, halves = np.arange(len(xyz)), nyu.half_cubes(len(xyz))
    if args.frames:
        rows = rows[np.linspace(0, len(xyz) - 1, min(args.frames, len(xyz))).astype(int)]
    half = halves[rows, None]
    center = xyz[rows].mean(axis=1, keepdims=True)
    targets = (xyz[rows] - center) / half[:, :, None]
    bar = progress_bar(len(rows), 0, " frames")
    progress = bar.update if bar else lambda done: None
    if args.swarm:
        found = fit_joints_by_swarm(skeleton, targets, chosen, particles=args.particles, generations=args.generations,
                          progress=progress)  # fmt: skip
    else:
        found = fit_joints(skeleton, targets, chosen, limits=not args.no_limits, ridge=args.ridge, starts=args.starts,
                        progress=progress)  # fmt: skip
    if bar:
        bar.close()
    residuals = found.residuals * half
    if args.out:

        def fill(path: Path) -> None:
            with h5py.File(path, "w") as file:
                file["dof"], file["residual_mm"] = found.inputs, residuals
                file["index"], file["center"], file["half_cube"] = rows, center[:, 0], half[:, 0]
                file.attrs["description"] = (
                    "dof: inputs of the hand model, radians, and half-cubes from center (mm, camera axes, y up)"
                )

        try:
            Path(args.out).parent.mkdir(parents=True, exist_ok=True)
            atomic.replace(Path(args.out), fill)
        except OSError as error:
            raise NetlibError(f"{args.out}: {reason_of(error)}") from None
    if warning := nyu.one_size_for_all(len(xyz)):
        print(warning, file=sys.stderr)
    return residuals, _broken(found.inputs, skeleton)


def _fit_list(args: argparse.Namespace, skeleton: Skeleton) -> tuple[Any, float]:
    if not args.out:
        raise NetlibError(f"{args.joints}: a list of HDF5 files; expected --out FOLDER for their angles")
    files, out = read_list(args.joints, None), Path(args.out)
    targets = companions.companions_of(files, out)
    residuals, inputs = [], []
    for number, (path, target) in enumerate(zip(files, targets), 1):
        residuals.append(companions.fit_file(path, target, skeleton, limits=not args.no_limits, ridge=args.ridge,
                                           starts=args.starts))  # fmt: skip
        with h5py.File(target, "r") as file:
            inputs.append(file["dof"][...])
        print(f"{number} of {len(files)}: {target}, {np.nanmean(residuals[-1]):.3f} mm", file=sys.stderr)
    atomic.replace_text(out / Path(args.joints).name, parts.list_text(targets))
    return np.concatenate(residuals), _broken(np.concatenate(inputs), skeleton)


def _broken(inputs: Any, skeleton: Skeleton) -> float:
    return metrics.fraction_out_of_limits(inputs, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=1e-6)


if __name__ == "__main__":
    sys.exit(main())
