"""The output of the tracker for one hand, as in ``handpose.output.tracks``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from handpose.body.sides import mirror_of
from handpose.fit.body import SIZE_INDEX, CapsuleModel, WorldPose, crop_variables
from handpose.fit.pose_confidence import Evidence, Judged
from handpose.tracking.hand_track import HandTrack, SideState
from handpose.tracking.track import TrackedHand, TrackedPoses
from netlib.blob import Array


def tracked_hand(
    track: HandTrack, model: CapsuleModel, *, smooth: bool, surface: bool
) -> TrackedHand:
    """A hand at its last pose.

    smooth   use the smoothed pose
    surface  include the surface
    """
    others = [
        seen for side, seen in track.sides.items() if side != track.hand and seen.time == track.time
    ]
    chances = (track.side_confidence, 1 - track.side_confidence)
    hand, *other = _as_sides(
        track, [track.best, *others], chances, model, smooth=smooth, surface=surface
    )
    return dataclasses.replace(hand, other=other[0]) if other else hand


def _as_sides(
    track: HandTrack,
    sides: Sequence[SideState],
    chances: Sequence[float],
    model: CapsuleModel,
    *,
    smooth: bool,
    surface: bool,
) -> list[TrackedHand]:
    """The hand in the states of its sides, of these probabilities."""
    found = [seen.estimate for seen in sides]
    center = np.stack([hand.view_center_mm for hand in found])
    mirror = np.stack([mirror_of(hand.hand) for hand in found])
    raw = variables_of(model, [seen.estimate.body for seen in sides], center, track.size)
    x = variables_of(model, [seen.smooth for seen in sides], center, track.size) if smooth else raw
    joints = model.joints(x)
    xyz = (joints + center[:, None]) * mirror[:, None]
    raw_xyz = (
        (model.joints(raw) + center[:, None]) * mirror[:, None] if smooth else [None] * len(found)
    )
    evidence = [hand.evidence for hand in found if hand.evidence is not None]
    if len(evidence) == len(found):  # the errors of the network were measured
        fitted = np.stack([hand.the_fit.joints[0] for hand in found])
        quality = track.judge.judged(Evidence.concatenate(evidence).lagging(model, joints, fitted))
    else:
        quality = Judged(
            *(np.array([getattr(hand, name) for hand in found]) for name in Judged._fields)
        )
    inputs = model.inputs_of(x)
    capsules = model.capsules(x, center).mirrored(mirror) if surface else None
    return [
        TrackedHand(
            id=track.id,
            hand=hand.hand,
            confidence=chances[n] * float(quality.confidence[n]),
            error_mm=float(quality.error_mm[n]),
            inputs=inputs[n],
            bones=model.skeleton.bones * float(np.exp(x[n, SIZE_INDEX])),
            origin_mm=hand.center_mm,
            xyz=xyz[n],
            center_uvd=hand.center_uvd,
            cube_mm=hand.cube_mm,
            capsules=None if capsules is None else capsules.frames(slice(n, n + 1)),
            side_confidence=chances[n],
            finger_error_mm=quality.finger_error_mm[n],
            raw_xyz=raw_xyz[n],
            poses=TrackedPoses(hand.body, seen.smooth, hand.error_mm, track.size)
            if smooth
            else None,
            presence=np.fmax(track.presence, quality.confidence[n]),
        )
        for n, (hand, seen) in enumerate(zip(found, sides))
    ]


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
