"""Tracked hands without a tracker: an open hand with its surface, and its depth image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.render import Capsules, render
from handpose.body.sides import Side, mirror_of
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import Camera
from handpose.tracking.track import TrackedHand, TrackHeader, joints_of
from tests.support.packaged_hand import SKELETON

CAMERA = Camera("small", 147.0, 147.0, 80.0, 60.0, 160, 120)
HEADER = TrackHeader("a recording", CAMERA, SKELETON)
_MODEL = CapsuleModel(HEADER.skeleton, HEADER.unit_mm)


def tracked(
    hand: Side = "right", at: ArrayLike = (0.0, 0.0, 600.0), id: int = 1, confidence: float = 0.93
) -> TrackedHand:
    """Return an open hand at a position in mm, camera axes."""
    sk, origin = HEADER.skeleton, np.array(at, dtype=np.float64)
    inputs, side = _stretched(), mirror_of(hand)
    x = _MODEL.variables_of(inputs[None])
    a, b, *radii = _MODEL.capsules(x, np.zeros((1, 3)))
    return TrackedHand(
        id,
        hand,
        confidence,
        8.0,
        inputs,
        sk.bones,
        origin,
        joints_of(sk, HEADER.unit_mm, hand, inputs, sk.bones, origin),
        CAMERA.project(origin),
        CUBE_MM,
        Capsules(a * side + origin, b * side + origin, *radii),
    )


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
        assert hand.capsules is not None
        np.minimum(image, render(hand.capsules, x[None], y[None], np.array([wall]))[0], out=image)
    return image
