"""The reason why a hand is not found at its expected place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import SideView, mirror_of
from handpose.estimate.expected import ExpectedBodies
from handpose.fit.body import WorldPose
from handpose.fit.support import Support
from handpose.frames.cameras import Camera
from handpose.frames.crops import FAR_FACE, NEAR_FACE, crop
from handpose.tracking.track import HIDDEN, LEFT
from netlib.blob import Array
from netlib.errors import DataError

NO_HAND, NO_POSE = "the object there does not look like a hand", "no pose was found there"
MIN_VISIBLE = 0.03  # minimum share of foreground in a crop
# A reason is given from this share on: of the hand's own surface or its crop that is behind nearer
# objects or without a reading, or of its joints that are outside the image.
PART = 0.25
# from this share of its surface outside the image on, any such joint gives the reason
MIN_OUTSIDE = 0.05


def uncertain(confidence: float) -> str:
    """The reason for which a pose is not given."""
    return f"the pose is uncertain (confidence {confidence:.0%})"


def why_missing(
    expected: ExpectedBodies, view: SideView, pose: WorldPose, confidence: float
) -> str:
    """The reason why a hand that was expected in this pose is not in its view of a frame.

    confidence  of the best pose found there
    """
    readings = np.asarray(view.readings, np.float32)
    limbs = expected.model.surface.limbs
    seen = expected.support.support(expected.capsules(pose), limbs, readings, view.camera)
    frame = view.of("right")  # as the camera sees it: the reason names its edges
    xyz = expected.joints(pose) * mirror_of(view.side)
    center = view.pixel_in("right", expected.center_of(pose, view.camera))
    shown = np.asarray(frame.readings, np.float32)
    return reason(shown, frame.camera, xyz, center, expected.cube_mm, seen, confidence)


def reason(
    depth: NDArray[np.float32],
    camera: Camera,
    xyz: Array,
    center_uvd: Array,
    cube_mm: float,
    support: Support,
    confidence: float,
) -> str:
    """The reason why a hand was not found where it was expected, with joints (K, 3) in
    mm, camera axes.

    depth       mm, with the readings that are nearer than the camera measures
    center_uvd  (3,) px, px, mm: centre of its crop, with an edge of ``cube_mm``
    support     of the expected pose by the frame
    confidence  of the best pose found there
    """
    if not (depth > 0).any():
        return "no depth in this frame"
    if left := _left(camera, xyz, PART):
        return left
    try:
        shown = crop(depth, center_uvd, cube_mm, camera)
    except DataError:
        return LEFT
    if support.hidden[0] > PART or (shown <= NEAR_FACE).mean() > PART:
        return f"{HIDDEN} by a nearer object"
    d = center_uvd[2]
    if (np.abs(shown) < FAR_FACE).mean() < MIN_VISIBLE:
        return f"only background at its last position, {d:.0f} mm away"
    if support.outside[0] > MIN_OUTSIDE and (left := _left(camera, xyz, 0.0)):
        return left
    if support.missing[0] > PART:
        return f"no depth at its last position, {d:.0f} mm away"
    return f"{NO_HAND} (confidence {confidence:.0%})"


def _left(camera: Camera, xyz: Array, share: float) -> str:
    """The reason that joints (K, 3) in mm are outside the image, with its edges; empty if no more
    than this share of them is.
    """
    if not (xyz[:, 2] > 0).all():  # at or behind the camera
        return LEFT
    u, v, _ = camera.project(xyz).T
    beyond = {
        "left": u < 0,
        "right": u > camera.width - 1,
        "upper": v < 0,
        "lower": v > camera.height - 1,
    }
    if not np.any(list(beyond.values()), axis=0).mean() > share:
        return ""
    edges = [edge for edge, joints in beyond.items() if joints.mean() > share / 2]
    return f"{LEFT} at the {' '.join(edges)} edge" if edges else LEFT
