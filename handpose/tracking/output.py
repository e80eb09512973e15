"""The output of the tracker for one hand, as in ``handpose.output.tracks``."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import mirror_of
from handpose.fit.body import SIZE
from handpose.fit.pose_confidence import judged, pose_signs
from handpose.fit.support import joint_depths, support
from handpose.tracking.hand_track import HandTrack, SideState
from handpose.tracking.pose_estimator import PoseEstimator
from handpose.tracking.track import TrackedHand


def tracked_hand(
    track: HandTrack, estimator: PoseEstimator, readings: NDArray[np.float32], *, smooth: bool, surface: bool
) -> TrackedHand:
    """A hand at its last pose, judged by the image with all readings, in mm.

    smooth   use the smoothed pose
    surface  include the surface
    """
    likely, side = track.side_confidence, track.hand
    hand = _as_side(track, track.best, likely, estimator, readings, smooth=smooth, surface=surface)
    others = [seen for other, seen in track.sides.items() if other != side and seen.time == track.time]
    if not others:
        return hand
    other = _as_side(track, others[0], 1 - likely, estimator, readings, smooth=smooth, surface=surface)
    return dataclasses.replace(hand, other=other)


def _as_side(
    track: HandTrack, seen: SideState, likely: float, estimator: PoseEstimator, readings: NDArray[np.float32], *,
    smooth: bool, surface: bool,
) -> TrackedHand:  # fmt: skip
    """The hand in the state of one side, of this probability."""
    model = estimator.fitter.model
    estimate, side = seen.estimate, seen.estimate.region.side
    mirror = mirror_of(side)
    x = estimator.converter.variables(seen.smooth if smooth else estimate.body, estimate.center_mm)[None]
    if track.size is not None:
        x[0, SIZE] = np.log(track.size)  # the known size, instead of a filtered one
    joints = model.joints(x)[0]
    capsules = model.capsules(x, estimate.center_mm[None]).mirrored(mirror)
    xyz = (joints + estimate.center_mm) * mirror
    error_mm, confidence = float(estimate.fit.error_mm[0]), float(estimate.fit.confidence[0])
    if np.isfinite(error_mm):  # the errors of the network were measured
        found = support(capsules, model.surface.limbs, readings, estimator.camera)
        lag = np.linalg.norm(joints - estimate.fit.joints[0], axis=1).mean(keepdims=True)
        depths, deep = joint_depths(xyz[None], readings, estimator.camera), model.surface.mean_penetration(capsules)
        signs = pose_signs(estimate.fit.signs, depths, deep)
        error_mm, confidence = (float(values[0]) for values in judged(signs, lag, found))
    return TrackedHand(
        id=track.id,
        hand=side,
        confidence=likely * confidence,
        error_mm=error_mm,
        inputs=model.inputs_of(x)[0],
        bones=model.skeleton.bones * float(np.exp(x[0, SIZE])),
        origin_mm=estimate.center_mm * mirror,
        xyz=xyz,
        center_uvd=estimate.region.center_uvd,
        cube_mm=estimator.cube_mm,
        capsules=capsules if surface else None,
        side_confidence=likely,
    )
