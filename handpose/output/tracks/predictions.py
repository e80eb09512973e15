"""Predictions for single images in the format of tracks: each image is a frame with one hand and
without a time.

A hand without joints, because its pose is not sure enough, is present, as in a track.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from handpose.body.joint_formats.formats import FormatName
from handpose.estimate.hand import Hand
from handpose.estimate.nets import is_hand
from handpose.output.tracks.json_values import FrameValues, header_values
from handpose.tracking.reasons import uncertain
from handpose.tracking.track import PresentHand, TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton


def tracked(found: Hand, skeleton: Skeleton) -> TrackedHand:
    """A prediction as a hand of a track. Values that only a fit determines are NaN without one.

    Without a frame, positions are from the crop's centre.
    """
    fitted, nan = found.fit is not None, math.nan
    return TrackedHand(
        id=0,
        hand=found.hand,
        confidence=found.confidence,
        error_mm=found.error_mm,
        inputs=found.inputs if fitted else np.full(len(skeleton.dof_names), nan),
        bones=skeleton.bones * found.size,
        origin_mm=found.center_mm if found.in_frame else np.zeros(3),
        xyz=found.xyz if found.in_frame else found.joints_mm,
        center_uvd=found.center_uvd if found.in_frame else np.full(3, nan),
        cube_mm=found.cube_mm,
        capsules=None,
        finger_error_mm=found.finger_error_mm,
        presence=found.presence,
    )


def frame_values(
    number: int, found: Hand, skeleton: Skeleton, joints: FormatName | None = None
) -> dict[str, Any]:
    """The frame of one prediction, with ``joints`` also in another format. Raises DataError."""
    values = FrameValues(_header("", found, skeleton), joints, in_frames=found.in_frame)
    if not found.has_joints:
        x, y, z = (found.center_mm if found.in_frame else np.zeros(3)).tolist()
        side = found.hand if is_hand(skeleton) else None
        present = PresentHand(
            0, side, found.presence, found.confidence, (x, y, z), uncertain(found.confidence)
        )
        return values.values(TrackedFrame(number, math.nan, (), present=(present,)))
    frame = values.values(TrackedFrame(number, math.nan, (tracked(found, skeleton),)))
    if not is_hand(skeleton):
        frame["hands"][0]["hand"] = None
    return frame


def document(
    source: str,
    found: Sequence[Hand],
    frames: Sequence[dict[str, Any]],
    skeleton: Skeleton,
    joints: FormatName | None = None,
) -> str:
    """The JSON text of predictions, at least one, and of their frames (``frame_values``)."""
    first, cameras = found[0], {hand.camera for hand in found}
    header = _header(source, first, skeleton)
    if len(cameras) > 1:  # images of several sizes
        header = dataclasses.replace(
            header, camera=dataclasses.replace(header.camera, width=0, height=0)
        )
    head = json.dumps(header_values(header, joints, in_frames=first.in_frame), allow_nan=False)
    lines = ",\n".join(json.dumps(frame, allow_nan=False) for frame in frames)
    return f'{head[:-1]}, "frames": [\n{lines}\n], "complete": true}}'


def _header(source: str, found: Hand, skeleton: Skeleton) -> TrackHeader:
    return TrackHeader(source, found.camera, skeleton, found.cube_mm / 2, smoothed=False)
