"""Tracked hands without a tracker: an open hand with its surface, and its depth image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.capsules import Capsules
from handpose.body.nyu import CUBE_MM
from handpose.body.render import render
from handpose.body.sides import Side, mirror_of
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import Camera
from handpose.tracking.reasons import NO_POSE
from handpose.tracking.track import HandPose, TrackedHand, TrackHeader, joints_of
from tests.support.packaged_hand import SKELETON

CAMERA = Camera("small", 147.0, 147.0, 80.0, 60.0, 160, 120)
HEADER = TrackHeader("a recording", CAMERA, SKELETON)
_MODEL = CapsuleModel(HEADER.skeleton, HEADER.unit_mm)


def tracked(
    hand: Side = "right", at: ArrayLike = (0.0, 0.0, 600.0), id: int = 1, confidence: float = 0.93
) -> TrackedHand:
    """Return an open hand at a position in mm, camera axes."""
    sk, origin = HEADER.skeleton, np.array(at, dtype=np.float64)
    inputs = _stretched()
    xyz = joints_of(sk, HEADER.unit_mm, hand, inputs, sk.bones, origin)
    center_uvd = CAMERA.project(origin)

    def surface() -> Capsules:
        x = _MODEL.variables_of(inputs[None])
        right = _MODEL.capsules(x, np.zeros((1, 3)))
        return right.mirrored(mirror_of(hand)).moved(origin[None])

    pose = HandPose(sk, hand, inputs, sk.bones, origin, xyz, center_uvd, CUBE_MM, surface=surface)
    return TrackedHand(id, hand, confidence, 8.0, pose)


def with_pose(hand: TrackedHand, **changes: object) -> TrackedHand:
    """Return a hand with changes of its pose."""
    return replace(hand, pose=replace(hand.the_pose, **changes))  # type: ignore[arg-type]


def present(id: int, presence: float, confidence: float, **fields: Any) -> TrackedHand:
    """Return a hand without a pose."""
    hand = {"hand": None, "place": (0.0, 0.0, 700.0), "reason": NO_POSE} | fields
    return TrackedHand(id, confidence=confidence, presence=presence, **hand)


def lost(
    id: int, hand: Side | None = "right", since: float = 0.0, reason: str = "hidden"
) -> TrackedHand:
    """Return a hand that is lost."""
    return TrackedHand(id, hand, reason=reason, since=since)


def facts(hands: Iterable[TrackedHand]) -> list[str]:
    """Return what is known of hands without a pose, to compare them."""
    return [
        f"{hand.id} {hand.hand} {hand.reason} {hand.presence:.6g} {hand.confidence:.6g} "
        f"{hand.since:.6g} {np.round(hand.place, 3)}"
        for hand in hands
    ]


def _stretched() -> NDArray[np.float64]:
    """The inputs (D,) of a hand with straight fingers and its thumb out."""
    sk = HEADER.skeleton
    bent = [name.endswith(("_base_rot_x", "_pip_rot_x", "_dip_rot_x")) for name in sk.dof_names]
    inputs = np.where(bent, -sk.initial, 0.0)
    thumb = sk.dof_names.index("thumb_pip_rot_z")
    inputs[thumb] = sk.lower[thumb]
    return inputs


def seen(hands: Sequence[TrackedHand], camera: Camera = CAMERA) -> NDArray[np.float32]:
    """Return the depth image (height, width) in mm of some hands in front of a wall."""
    wall = 1500.0
    image = np.full((camera.height, camera.width), wall, dtype=np.float32)
    x = (np.arange(camera.width) - camera.u0) / camera.fx
    y = (np.arange(camera.height) - camera.v0) / camera.fy
    for hand in hands:
        capsules = hand.the_pose.capsules
        assert capsules is not None
        np.minimum(image, render(capsules, x[None], y[None], np.array([wall]))[0], out=image)
    return image
