"""Angles of published predictions, which are joints: fit the hand model to those of every method, and compare.

The annotation is fitted within the limits with a ridge, which keeps angles that 14 joints do not determine at the
initial pose; predictions are fitted within the limits without a ridge. A method whose joints lie on the model is fitted
once more, without limits and from many starts, to count the frames with an angle out of its limits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from handpose.body import nyu
from handpose.fit.joints import angles
from handpose.fit.joints.absolute_joints import fit_absolute
from handpose.scoring import metrics
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

RIDGE = 3e-3  # ridge of the fits to the annotation
ON_MODEL_MM = 0.05  # residual of most frames if a hand model made their joints; with few starts some fit badly
TOLERANCE = 1e-3  # radians beyond a limit that count as within: joints in text files are rounded


class Watcher(Protocol):
    """Reports the progress of fits."""

    def __call__(self, total: int, *, what: str) -> AbstractContextManager[Callable[[int], None]]:
        """A context for the fit of ``total`` frames; it yields a callback for the number of further frames done."""


@dataclass(frozen=True)
class FittedAngles:
    """The result of fitting the hand model to the joints of a method."""

    error_deg: float  # mean over frames and rotations
    residual_mm: float  # mean distance that the fit within the limits leaves
    free_residual_mm: float  # the same without limits
    out_of_limits: float | None  # fraction of the frames; None where the joints do not lie on the model


def compare_angles(
    skeleton: Skeleton,
    truth: Array,
    predictions: Mapping[str, Array],
    watch: Watcher = lambda total, what: nullcontext(lambda done: None),
) -> dict[str, FittedAngles]:
    """Fit the hand to NYU's true joints (N, 14, 3) in mm and to those of each method, and compare."""
    half = nyu.half_cubes(len(truth))

    def fitted(joints: Array, what: str, **options: Any) -> tuple[Array, Array]:
        """Inputs (N, D), and the mean remaining distance (N,) of each frame's joints in mm."""
        with watch(len(joints), what=what) as progress:
            found = fit_absolute(skeleton, joints, half, nyu.EVALUATION_JOINTS, progress=progress, **options)
        return found.inputs, found.residuals.mean(axis=1) * half

    true_inputs, _ = fitted(truth, "annotation", ridge=RIDGE)
    results = {}
    for name, joints in predictions.items():
        inputs, residual = fitted(joints, name)
        free, free_residual = fitted(joints, f"{name}, no limits", limits=False, starts=2)
        broken = None
        if np.median(free_residual) < ON_MODEL_MM:
            free, free_residual = fitted(joints, f"{name}, exactly", limits=False, starts=256)
            broken = metrics.fraction_out_of_limits(
                free, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=TOLERANCE
            )
        error = float(angles.angle_errors(skeleton, inputs, true_inputs).mean())
        results[name] = FittedAngles(error, float(residual.mean()), float(free_residual.mean()), broken)
    return results
