"""The output of the tracker for one hand, as in ``handpose.output.tracks``."""

from __future__ import annotations

import dataclasses

import numpy as np

from handpose.body.sides import mirror_of
from handpose.fit.body import SIZE
from handpose.tracking.hand_track import HandTrack, SideState
from handpose.tracking.pose_estimator import PoseEstimator
from handpose.tracking.track import TrackedHand


def tracked_hand(track: HandTrack, estimator: PoseEstimator, *, smooth: bool, surface: bool) -> TrackedHand:
    """A hand at its last pose.

    smooth   use the smoothed pose
    surface  include the surface
    """
    likely, side = track.side_confidence, track.hand
    hand = _as_side(track, track.best, likely, estimator, smooth=smooth, surface=surface)
    others = [seen for other, seen in track.sides.items() if other != side and seen.time == track.time]
    if not others:
        return hand
    other = _as_side(track, others[0], 1 - likely, estimator, smooth=smooth, surface=surface)
    return dataclasses.replace(hand, other=other)


def _as_side(
    track: HandTrack, seen: SideState, likely: float, estimator: PoseEstimator, *, smooth: bool, surface: bool
) -> TrackedHand:
    """The hand in the state of one side, of this probability."""
    model = estimator.fitter.model
    estimate, side = seen.estimate, seen.estimate.region.side
    mirror = mirror_of(side)
    x = estimator.converter.variables(seen.smooth if smooth else estimate.body, estimate.center_mm)[None]
    if track.size is not None:
        x[0, SIZE] = np.log(track.size)  # the known size, instead of a filtered one
    capsules = None
    if surface:
        capsules = model.capsules(x, estimate.center_mm[None]).mirrored(mirror)
    return TrackedHand(
        id=track.id,
        hand=side,
        confidence=likely * float(estimate.fit.confidence[0]),
        error_mm=float(estimate.fit.error_mm[0]),
        inputs=model.inputs_of(x)[0],
        bones=model.skeleton.bones * float(np.exp(x[0, SIZE])),
        origin_mm=estimate.center_mm * mirror,
        xyz=(model.joints(x)[0] + estimate.center_mm) * mirror,
        center_uvd=estimate.region.center_uvd,
        cube_mm=estimator.cube_mm,
        capsules=capsules,
        side_confidence=likely,
    )
