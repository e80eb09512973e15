"""Evaluation of the fit to the depth on synthetic frames: errors, sides, confidence, by rotation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose import Camera
from handpose.body.sides import SIDES
from handpose.estimate.estimator import fit_crops, fit_starts
from handpose.fit.depth_fit import DepthFit, DepthFitter
from handpose.fit.observation import HandCrops
from handpose.fit.search import Plan
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic.generator import BLOCK, Generator
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.net import Net


@dataclass(frozen=True)
class Block:
    """Frames of one camera: crops (n, S, S), centres (n, 3) px, px, mm, true joints (n, K, 3) in mm and inputs.

    unit  mm in a half-cube of the crops
    """

    crops: NDArray[np.float32]
    center_uvd: Array
    camera: Camera
    joints: Array
    inputs: Array
    unit: float


def frames_of(generator: Generator, frames: int) -> Iterator[Block]:
    """The first ``frames`` frames of a generator."""
    for number in range(-(-frames // BLOCK)):
        scene, n = generator.scene(number), min(BLOCK, frames - number * BLOCK)
        joints = scene.bodies.joints[:n] * scene.cube_mm / 2
        inputs, unit = scene.bodies.inputs[:n], scene.cube_mm / 2
        yield Block(scene.depth[:n], scene.center_uvd[:n], scene.camera, joints, inputs, unit)


@dataclass(frozen=True)
class Figures:
    """The results for N frames.

    network  (N,) mean error in mm over NYU's 14 joints of the network alone
    fits     per plan, (N,) that of the fit
    uncertainty, expected, confidence  per plan, (N,) of the fit
    signs    per plan, (N, 5): from which the uncertainty is computed
    right    per plan, (N,) True if the frame's fit is less uncertain than its mirror image's; if requested
    roll     (N,) degrees: rotation of the palm in the image from its mean pose, -180 to 180
    limbs    (N, L) errors of the limbs' inputs of the network
    poses    (N, L) the limbs' inputs themselves
    """

    network: Array
    fits: dict[str, Array]
    uncertainty: dict[str, Array]
    signs: dict[str, Array]
    expected: dict[str, Array]
    confidence: dict[str, Array]
    right: dict[str, Array]
    roll: Array
    limbs: Array
    poses: Array


def measure(
    net: Net,
    fitter_of: Callable[[float], DepthFitter],
    blocks: Iterator[Block],
    plans: Sequence[Plan],
    *,
    hands: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> Figures:
    """Fit frames by several plans, with the fitter for the unit of their crops.

    hands     fit their mirror images, too
    progress  called with the number of further frames done
    """
    parts: list[dict[str, Array]] = []
    fitters: dict[float, DepthFitter] = {}
    for block in blocks:
        if block.unit not in fitters:
            fitters[block.unit] = fitter_of(block.unit)
        fitter = fitters[block.unit]
        x = fit_starts(net, fitter.model, block.crops, (0,))[0]
        truth, limbs = fitter.model.variables_of(block.inputs), fitter.model.limbs
        part = {
            "network": mean_errors_14(fitter.model.joints(x), block.joints),
            "limbs": (x - truth)[:, limbs],
            "poses": truth[:, limbs],
            "roll": roll_of(fitter.model.skeleton, block.inputs),
        }
        right, left = (
            HandCrops.of_sides(block.crops, block.center_uvd, block.camera, 2 * block.unit, side) for side in SIDES
        )
        for plan in plans:
            fit = fit_crops(net, fitter, right, plan)
            part |= {f"{name} {plan.name}": values for name, values in _of(fit, block).items()}
            if hands:
                part[f"right {plan.name}"] = fit.uncertainty < fit_crops(net, fitter, left, plan).uncertainty
        parts.append(part)
        progress(len(block.crops))
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def per_plan(name: str) -> dict[str, Array]:
        columns = {plan.name: f"{name} {plan.name}" for plan in plans}
        return {plan: whole[column] for plan, column in columns.items() if column in whole}

    return Figures(
        network=whole["network"],
        fits=per_plan("fit"),
        uncertainty=per_plan("uncertainty"),
        signs=per_plan("signs"),
        expected=per_plan("expected"),
        confidence=per_plan("confidence"),
        right=per_plan("right"),
        roll=whole["roll"],
        limbs=whole["limbs"],
        poses=whole["poses"],
    )


def roll_of(skeleton: Skeleton, inputs: Array) -> Array:
    """(N,) degrees by which the palm is turned about the line of sight from the skeleton's initial pose."""
    turn = inputs[:, skeleton.dof_names.index("palm_rot_z")]
    return np.asarray(np.rad2deg((turn + np.pi) % (2 * np.pi) - np.pi))


def auc(score: Array, failed: NDArray[np.bool_]) -> float:
    """The chance that a failed frame has a higher score than another (area under the ROC curve); NaN without both."""
    order = np.argsort(score, kind="stable")
    ranks = np.empty(len(score))
    ranks[order] = np.arange(1, len(score) + 1)
    bad, good = int(failed.sum()), int((~failed).sum())
    if not bad or not good:
        return float("nan")
    return float((ranks[failed].sum() - bad * (bad + 1) / 2) / (bad * good))


def _of(fit: DepthFit, block: Block) -> dict[str, Array]:
    return {
        "fit": mean_errors_14(fit.joints, block.joints),
        "uncertainty": fit.uncertainty,
        "signs": fit.signs,
        "expected": fit.error_mm,
        "confidence": fit.confidence,
    }
