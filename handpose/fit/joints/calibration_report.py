"""The report of a calibration in mm and degrees, and the comment at the top of the skeleton file."""

from __future__ import annotations

import textwrap

import numpy as np

from handpose.fit.joints.angles import rotations
from handpose.fit.joints.calibration import Calibration
from handpose.fit.joints.observations import Observations
from layers.hand.skeleton import Skeleton
from netlib.errors import printable


def comment(
    template: Skeleton, frames: Observations, found: Calibration, unit: float, *, source: str, percentile: float
) -> str:
    """The comment at the top of the skeleton file: its sources, and the meaning of the numbers.

    unit        half-cube of the skeleton in mm
    source      name of the file with the annotations
    percentile  of the limits
    """
    before, after = (float(np.nanmean(r)) * unit for r in (found.before, found.after))
    some = "" if len(frames.joints) == len(template.parents) else f": {_names(template, frames)}"
    facts = (
        f"One person's hand, calibrated by tools/calibrate_hand.py from {len(frames.targets)} of the {frames.rows} "
        f"frames of {source!r} and {len(frames.joints)} of {len(template.parents)} joints{some}. "
        f"The mean distance of the joints from the hand is {after:.2f} mm; from the template, skeleton "
        f"{template.name!r} scaled by {found.scale:.3f}, it was {before:.2f} mm."
    )
    undetermined = (
        "The frames alone do not determine these, so they are held near the scaled template: "
        f"{_listed([f'the bone of {name}' for name in found.undetermined_bones] + found.undetermined_angles)}."
    )
    meaning = (
        f"Lengths are in half-cubes of {unit:g} mm, angles in radians. Axes: x right, y up, z away from the camera; "
        "the origin is the crop centre. A DoF's value is its input plus `initial` (the median); limits apply to the "
        f"input (percentiles {percentile:g} and {100 - percentile:g}; the whole hand has the template's). "
        "A fixed DoF keeps its initial value. A joint turns about the local axes in the order written, at its parent's "
        "position (a root: after its translation), then moves along its own local axis by its bone."
    )
    return "\n".join(textwrap.fill(" ".join(part.split()), 110) for part in (facts, undetermined, meaning))


def _names(template: Skeleton, frames: Observations) -> str:
    return ", ".join(template.joint_names[j] for j in frames.joints)


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "nothing"


def report(template: Skeleton, frames: Observations, found: Calibration, unit: float) -> str:
    """The results: bones and distances in mm, limits in degrees. ``unit`` is the skeleton's half-cube in mm."""
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
    return "\n".join(printable(line) for line in [
        *lines,
        "",
        f"{len(frames.targets)} of {frames.rows} frames, {seen} joints ({frames.unseen} more unknown or cut off)",
        f"fixed rotations not determined: {_listed(found.undetermined_angles)}",
        f"size: {found.scale:.3f} of the template; a unit of the skeleton is {unit:g} mm (frames: {cubes} mm)",
        f"joints from the hand, mean: {before:.2f} mm before (scaled template), {after:.2f} mm now; "
        f"worst frame {worst:.2f} mm",
    ])


def _range(skeleton: Skeleton, dof: int) -> str:
    """The limits of a DoF's value: initial value and input together."""
    low, high = np.rad2deg(skeleton.initial[dof] + np.array([skeleton.lower[dof], skeleton.upper[dof]]))
    return f"{round(low)} to {round(high)}"
