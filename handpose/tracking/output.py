"""The output of the tracker for one hand, as in ``handpose.output.tracks``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import mirror_of
from handpose.fit.body import SIZE, CapsuleModel, WorldPose, crop_variables
from handpose.fit.pose_confidence import Judged, judged_poses
from handpose.tracking.hand_track import HandTrack, SideState
from handpose.tracking.pose_estimator import PoseEstimator
from handpose.tracking.track import TrackedHand, TrackedPoses
from netlib.blob import Array


def tracked_hand(
    track: HandTrack, estimator: PoseEstimator, readings: NDArray[np.float32], *, smooth: bool, surface: bool
) -> TrackedHand:
    """A hand at its last pose, judged by the image with all readings, in mm.

    smooth   use the smoothed pose
    surface  include the surface
    """
    others = [seen for side, seen in track.sides.items() if side != track.hand and seen.time == track.time]
    chances = (track.side_confidence, 1 - track.side_confidence)
    hand, *other = _as_sides(track, [track.best, *others], chances, estimator, readings, smooth=smooth, surface=surface)
    return dataclasses.replace(hand, other=other[0]) if other else hand


def _as_sides(
    track: HandTrack, sides: Sequence[SideState], chances: Sequence[float], estimator: PoseEstimator,
    readings: NDArray[np.float32], *, smooth: bool, surface: bool,
) -> list[TrackedHand]:
    """The hand in the states of its sides, of these probabilities."""
    model, found = estimator.model, [seen.estimate for seen in sides]
    center = np.stack([hand.mirrored_center_mm for hand in found])
    mirror = np.stack([mirror_of(hand.hand) for hand in found])
    raw = variables_of(model, [seen.estimate.body for seen in sides], center, track.size)
    x = variables_of(model, [seen.smooth for seen in sides], center, track.size) if smooth else raw
    xyz = (model.joints(x) + center[:, None]) * mirror[:, None]
    raw_xyz = (model.joints(raw) + center[:, None]) * mirror[:, None] if smooth else [None] * len(found)
    error_mm, confidence = (np.array([getattr(hand, name) for hand in found]) for name in ("error_mm", "confidence"))
    judged = Judged(error_mm, confidence, np.stack([hand.finger_error_mm for hand in found]))
    if np.isfinite(error_mm).all():  # the errors of the network were measured
        fitted = np.stack([hand.joints_mm for hand in found]) * mirror[:, None]
        signs = np.stack([hand.signs for hand in found])
        judged = judged_poses(model, x, center, mirror, signs, fitted, readings, estimator.camera)
    inputs = model.inputs_of(x)
    capsules = model.capsules(x, center).mirrored(mirror) if surface else None
    return [
        TrackedHand(
            id=track.id,
            hand=hand.hand,
            confidence=chances[n] * float(judged.confidence[n]),
            error_mm=float(judged.error_mm[n]),
            inputs=inputs[n],
            bones=model.skeleton.bones * float(np.exp(x[n, SIZE])),
            origin_mm=hand.center_mm,
            xyz=xyz[n],
            center_uvd=hand.center_uvd,
            cube_mm=estimator.cube_mm,
            capsules=None if capsules is None else capsules.frames(slice(n, n + 1)),
            side_confidence=chances[n],
            finger_error_mm=judged.finger_error_mm[n],
            raw_xyz=raw_xyz[n],
            poses=TrackedPoses(hand.body, seen.smooth, hand.error_mm, track.size) if smooth else None,
        )
        for n, (hand, seen) in enumerate(zip(found, sides))
    ]


def variables_of(model: CapsuleModel, poses: Sequence[WorldPose], center: Array, size: float | None) -> Array:
    """The model's variables (N, V) of poses in crops with these centres (N, 3), of the known size if there is one."""
    x = np.stack([crop_variables(model, *pose) for pose in zip(poses, center)])
    if size is not None:
        x[:, SIZE] = np.log(size)  # instead of a filtered one
    return x
