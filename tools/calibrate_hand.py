#!/usr/bin/env python3
"""Make a skeleton file for one person's hand from annotated frames: bones, fixed directions, initial pose and limits.

    python tools/calibrate_hand.py data/me/train.txt --out prototxt/hand/me.prototxt

ANNOTATIONS is an HDF5 file, or a list (.txt) of such files as HDF5Data reads it, with the data set joint (rows of
31 x 3 half-cubes from the crop centre, or of the 14 joints that NYU is scored on) and perhaps half_cube (mm). All
frames must show the same person. Joints that the cube cut off are left out.

What the frames do not determine is held near the template, scaled to the size of the hand; the table says which bones
those are. "+-" is the standard deviation.
Limits are percentiles of the frames' angles, so the frames should show all that the hand can do.
A hand model takes the file as skeleton: "FILE" in its hand_model_param, and the same in phys_limit_param.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels

# isort: split

import numpy as np

from handpose.facts.nyu import CUBE_MM
from handpose.fitting.angles import rotations
from handpose.fitting.calibration import Calibration, calibrate
from handpose.fitting.calibration_problem import FEWEST_FRAMES
from handpose.fitting.observations import Observations, read_observations
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.atomic import replace_text
from netlib.errors import NetlibError, reason_of
from tools.console import DONE, duration, guarded, natural, positive, progress_bar

LARGE_MM = 4.0  # left on the mean; careful annotation of one person leaves 3 mm (NYU's two test subjects)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", metavar="ANNOTATIONS", help="an HDF5 file, or a list of them (.txt)")
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the skeleton file to write")
    parser.add_argument("--template", metavar="SKELETON", help="a skeleton file to start from (default: the NYU hand)")
    parser.add_argument("--frames", type=positive, default=2000, metavar="N",
                        help="use so many, drawn at random (default: %(default)s; more hardly help)")  # fmt: skip
    parser.add_argument("--joints", type=int, choices=(31, 14), help="use so many of NYU's (default: all there are)")
    parser.add_argument("--half-cube", type=float, metavar="MM",
                        help="unit of the skeleton, and of frames without half_cube (default: "
                             f"that of most frames, else {CUBE_MM / 2:g})")  # fmt: skip
    parser.add_argument("--percentile", type=float, default=0.5, metavar="P",
                        help="limits are the P-th and (100 - P)-th percentiles (default: %(default)s)")  # fmt: skip
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="of all that is drawn (default: 0)")
    parser.add_argument("--force", action="store_true", help="replace FILE if it is there")
    args = parser.parse_args(argv)
    if args.frames < FEWEST_FRAMES:
        parser.error(f"--frames must be at least {FEWEST_FRAMES}, found {args.frames}")
    if args.half_cube is not None and not 0 < args.half_cube < np.inf:
        parser.error(f"--half-cube must be more than 0, found {args.half_cube:g}")
    if not 0 <= args.percentile < 50:
        parser.error(f"--percentile must be at least 0 and less than 50, found {args.percentile:g}")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Calibrate as the parsed arguments say. Raises NetlibError."""
    _check_out(args.out, args.force)
    template = skeletons.load(args.template) if args.template else skeletons.load()
    frames = read_observations(
        args.annotations, template, args.joints, args.frames, args.seed, args.half_cube or CUBE_MM / 2
    )
    cubes, counts = np.unique(frames.half_cube, return_counts=True)
    unit = args.half_cube or float(cubes[counts.argmax()])
    begun = time.perf_counter()
    bar = progress_bar(len(frames.targets), 0, " frames")
    try:
        found = calibrate(template, frames.targets * (frames.half_cube / unit)[:, None, None], frames.joints,
                          percentile=args.percentile, seed=args.seed,
                          progress=bar.update if bar else lambda done: None)  # fmt: skip
    finally:
        if bar:
            bar.close()
    try:
        replace_text(
            args.out, skeletons.text_of(found.skeleton, args.out.stem, _comment(args, template, frames, found, unit))
        )
    except OSError as error:
        raise NetlibError(f"{args.out}: cannot write the skeleton: {reason_of(error)}") from None
    print(_report(template, frames, found, unit))
    print(f"wrote {args.out} in {duration(time.perf_counter() - begun)}")
    after = float(np.nanmean(found.after)) * unit
    if after > LARGE_MM:
        print(f"warning: the joints are still {after:.1f} mm from the hand on the mean; are all frames of one person, "
              "and their joints in this order?", file=sys.stderr)  # fmt: skip
    return DONE


def _check_out(out: Path, force: bool) -> None:
    """Raise NetlibError at once rather than after the work if the file cannot be written."""
    if not out.parent.is_dir():
        raise NetlibError(f"{out}: no folder {out.parent}")
    if out.is_dir():
        raise NetlibError(f"{out}: is a folder; expected the name of a file")
    if out.exists() and not force:
        raise NetlibError(f"{out}: is there already; choose another --out, or use --force to replace it")


def _comment(
    args: argparse.Namespace, template: Skeleton, frames: Observations, found: Calibration, unit: float
) -> str:
    """The top of the file: what it was made from, and what the numbers mean."""
    before, after = (float(np.nanmean(r)) * unit for r in (found.before, found.after))
    some = "" if len(frames.joints) == len(template.parents) else f": {_names(template, frames)}"
    facts = (
        f"One person's hand, calibrated by tools/calibrate_hand.py from {len(frames.targets)} of the {frames.rows} "
        f"frames of {Path(args.annotations).name!r} and {len(frames.joints)} of {len(template.parents)} joints{some}. "
        f"Their mean distance from the hand is {after:.2f} mm; it was {before:.2f} mm from the template, skeleton "
        f"{template.name!r} scaled by {found.scale:.3f}."
    )
    undetermined = (
        "Not determined by the frames alone, and so held near the scaled template: "
        f"{_listed([f'the bone of {name}' for name in found.undetermined_bones] + found.undetermined_angles)}."
    )
    meaning = (
        f"Lengths are in half-cubes of {unit:g} mm, angles in radians. Axes: x right, y up, z away from the camera; "
        "the origin is the crop centre. A DoF's value is its input plus `initial` (the median); limits apply to the "
        f"input (percentiles {args.percentile:g} and {100 - args.percentile:g}; the whole hand has the template's). "
        "A fixed DoF keeps its initial value. A joint turns about the local axes in the order written, at its parent's "
        "position (a root: after its translation), then moves along its own local axis by its bone."
    )
    return "\n".join(textwrap.fill(" ".join(part.split()), 110) for part in (facts, undetermined, meaning))


def _names(template: Skeleton, frames: Observations) -> str:
    return ", ".join(template.joint_names[j] for j in frames.joints)


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "nothing"


def _report(template: Skeleton, frames: Observations, found: Calibration, unit: float) -> str:
    """What was found, in mm and degrees."""
    skeleton = found.skeleton
    lines = [f"{'bone, mm':<22}{'template':>9}{'now':>9}{'+-':>7}"]
    for joint in np.flatnonzero(skeleton.bone_axes >= 0):
        old, new, deviation = np.abs([template.bones[joint], skeleton.bones[joint], found.bone_deviation[joint]]) * unit
        name = skeleton.joint_names[joint]
        note = "  not determined" if name in found.undetermined_bones else ""
        lines.append(f"{name:<22}{old:>9.1f}{new:>9.1f}{deviation:>7.1f}{note}")
    lines += ["", f"{'limits, degrees':<22}{'template':>14}{'now':>14}"]
    for dof in rotations(skeleton):
        if (skeleton.lower[dof], skeleton.upper[dof]) != (template.lower[dof], template.upper[dof]):
            lines.append(f"{skeleton.dof_names[dof]:<22}{_range(template, dof):>14}{_range(skeleton, dof):>14}")
    before, after = (np.nanmean(r) * unit for r in (found.before, found.after))
    worst = np.nanmean(found.after, axis=1).max() * unit
    seen = np.count_nonzero(~np.isnan(frames.targets[:, :, 0]))
    cubes = " and ".join(f"{half:g}" for half in np.unique(frames.half_cube))
    return "\n".join([
        *lines,
        "",
        f"{len(frames.targets)} of {frames.rows} frames, {seen} joints ({frames.unseen} more unknown or cut off)",
        f"fixed rotations not determined: {_listed(found.undetermined_angles)}",
        f"size: {found.scale:.3f} of the template; a unit of the skeleton is {unit:g} mm (frames: {cubes} mm)",
        f"joints from the hand, mean: {before:.2f} mm before (scaled template), {after:.2f} mm now; "
        f"worst frame {worst:.2f} mm",
    ])  # fmt: skip


def _range(skeleton: Skeleton, dof: int) -> str:
    """The limits of a DoF's value: initial value and input together."""
    low, high = np.rad2deg(skeleton.initial[dof] + np.array([skeleton.lower[dof], skeleton.upper[dof]]))
    return f"{round(low)} to {round(high)}"


if __name__ == "__main__":
    sys.exit(main())
