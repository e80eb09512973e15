"""What the networks of Table 1 reach on the test set, and which of the paper's findings these figures confirm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handpose.experiments.networks import Network
from handpose.facts import nyu
from handpose.fitting import angles
from handpose.fitting.levenberg_marquardt import fit_joints
from handpose.scoring import metrics
from handpose.scoring.held_out import Predictions, figures_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


@dataclass(frozen=True)
class Result:
    """The figures of a network."""

    error_14_mm: float
    error_mm: float
    angle_deg: float  # mean over the 23 rotations
    out_of_limits: float | None  # fraction of frames; None for networks without angles
    within_40_mm: float


@dataclass(frozen=True)
class Answers:
    """What a network says of the test set: its predictions, and the angles of the hand in them."""

    network: Network
    predictions: Predictions
    inputs: Array  # (N, D) of the hand model

    def joint_errors(self) -> Array:
        """(N, 14) mm."""
        chosen, scale = list(nyu.EVALUATION_JOINTS), self.predictions.half_cube[:, None, None]
        joints, truth = self.predictions.joints[:, chosen], self.predictions.truth[:, chosen]
        return metrics.joint_errors(joints * scale, truth * scale)

    def angle_errors(self, truth: Array, skeleton: Skeleton) -> Array:
        """(N, R) degrees, against the true inputs (N, D)."""
        return angles.angle_errors(skeleton, self.inputs, truth)


def angles_of(predictions: Predictions, skeleton: Skeleton) -> Array:
    """Inputs (N, D) of the hand that a network predicts: its own, or fitted within the limits to its joints."""
    if predictions.dof is not None:
        return np.where(skeleton.fixed, 0.0, predictions.dof.astype(np.float64))
    return fit_joints(skeleton, predictions.joints.astype(np.float64), limits=True, starts=4).inputs


def result_of(answers: Answers, truth: Array, skeleton: Skeleton) -> Result:
    """The figures of a network; ``truth`` are the true inputs (N, D)."""
    figures = figures_of(answers.predictions, skeleton)
    return Result(
        error_14_mm=figures["error_14_mm"],
        error_mm=figures["error_mm"],
        angle_deg=float(answers.angle_errors(truth, skeleton).mean()),
        out_of_limits=figures.get("out_of_limits"),
        within_40_mm=figures["within_40_mm"],
    )


def findings(results: Mapping[str, Result]) -> list[str]:
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
