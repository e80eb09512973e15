"""The results of hands: of a track at its last pose, and of an estimate in a single image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from handpose.body.capsules import Capsules
from handpose.body.sides import mirror_of
from handpose.estimate.hand import HandEstimate, with_quality
from handpose.estimate.nets import is_hand
from handpose.fit.body import SIZE_INDEX, CapsuleModel, WorldPose, crop_variables
from handpose.tracking.hand_track import HandTrack, SideState
from handpose.tracking.reasons import uncertain
from handpose.tracking.track import HandPose, TrackedHand, TrackedPoses
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


def tracked_hand(track: HandTrack, model: CapsuleModel, *, smooth: bool) -> TrackedHand:
    """A hand at its last pose, which is the smoothed one if it is to be ``smooth``."""
    chance = track.side_confidence
    found = _as_side(track, track.best, chance, model, smooth)
    for side, seen in track.sides.items():
        if side != track.hand and seen.time == track.time:
            return replace(found, other=_as_side(track, seen, 1 - chance, model, smooth))
    return found


def _as_side(
    track: HandTrack, seen: SideState, chance: float, model: CapsuleModel, smooth: bool
) -> TrackedHand:
    """The hand in the state of one of its sides, which has this probability."""
    estimate = seen.estimate
    center = seen.estimate.view_center_mm[None]
    x = variables_of(model, [estimate.body], center, track.size)
    pose = posed(_pose_of(estimate, model.skeleton), model, x)
    if smooth:
        x = variables_of(model, [seen.smooth], center, track.size)
        pose = replace(
            posed(pose, model, x),
            raw_xyz=pose.xyz,
            followed=TrackedPoses(estimate.body, seen.smooth, estimate.error_mm, track.size),
        )
    if estimate.evidence is not None:  # the errors of the network were measured
        lag = estimate.evidence.lagging(model, model.joints(x), estimate.the_fit.joints)
        estimate = with_quality(estimate, track.judge.judged(lag), 0)
    found = _result(track.id, estimate, pose)
    return replace(
        found,
        confidence=chance * found.confidence,
        presence=np.fmax(track.looks.presence, found.confidence),
        side_confidence=chance,
    )


def predicted_hand(found: HandEstimate, skeleton: Skeleton) -> TrackedHand:
    """The hand of a single image, with the number 0. It has no side if the body is none.

    Values that only a fit determines are NaN without one. Without a frame, positions are from the
    crop's centre.
    """
    pose = _pose_of(found, skeleton)
    hand = _result(0, found, pose)
    if not is_hand(skeleton):
        hand = replace(hand, hand=None)
    if found.has_joints:
        return hand
    return hand.without_pose(hand.hand, pose.origin_mm, uncertain(found.confidence))


def _result(id: int, found: HandEstimate, pose: HandPose) -> TrackedHand:
    """What an estimate shows of a hand, in this pose."""
    return TrackedHand(
        id,
        found.hand,
        found.confidence,
        found.error_mm,
        pose,
        presence=found.presence,
        finger_error_mm=found.finger_error_mm,
    )


def _pose_of(found: HandEstimate, skeleton: Skeleton) -> HandPose:
    """The pose of an estimate, without its surface."""
    unknown = np.full(len(skeleton.dof_names), math.nan)
    if found.in_frame:
        origin_mm, xyz, center_uvd = found.center_mm, found.xyz, found.center_uvd
    else:
        origin_mm, xyz, center_uvd = np.zeros(3), found.joints_mm, np.full(3, math.nan)
    return HandPose(
        skeleton,
        found.hand,
        inputs=unknown if found.fit is None else found.inputs,
        bones=skeleton.bones * found.size,
        origin_mm=origin_mm,
        xyz=xyz,
        center_uvd=center_uvd,
        cube_mm=found.cube_mm,
    )


def posed(pose: HandPose, model: CapsuleModel, x: Array) -> HandPose:
    """The pose with these variables (1, V) of the model, in the same crop."""
    mirror = mirror_of(pose.side)
    center = pose.origin_mm * mirror
    size = float(np.exp(x[0, SIZE_INDEX]))
    joints = model.joints(x)[0] + center
    return replace(
        pose,
        inputs=model.inputs_of(x)[0],
        bones=model.skeleton.bones * size,
        xyz=joints * mirror,
        surface=partial(_surface, model, x, center, mirror),
    )


def _surface(model: CapsuleModel, x: Array, center: Array, mirror: Array) -> Capsules:
    return model.capsules(x, center[None]).mirrored(mirror[None])


def variables_of(
    model: CapsuleModel, poses: Sequence[WorldPose], center: Array, size: float | None
) -> Array:
    """The model's variables (N, V) of poses in crops with these centres (N, 3), of the known size
    if there is one.
    """
    x = np.stack([crop_variables(model, *pose) for pose in zip(poses, center)])
    if size is not None:
        x[:, SIZE_INDEX] = np.log(size)  # instead of a filtered one
    return x
