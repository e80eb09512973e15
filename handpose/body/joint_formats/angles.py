"""Joint angles of a hand in anatomical terms, in degrees.

    FINGER_mcp_flexion     of the first phalanx from the line of its metacarpal towards the palm; extension is negative
    FINGER_mcp_abduction   of the first phalanx away from the middle finger, in the plane of the palm; adduction is
                           negative. Of the middle finger: towards the index finger
    FINGER_pip_flexion     between the first and the second phalanx, towards the palm
    FINGER_dip_flexion     between the second and the third one
    thumb_cmc_radial_abduction   of the metacarpal away from that of the index finger, in the plane of the palm
    thumb_cmc_palmar_abduction   of the metacarpal out of the plane of the palm, to the side of the palm
    thumb_mcp_flexion, thumb_ip_flexion   between the bones of the thumb, towards the fingers

A straight finger in line with its metacarpal has only zeros. Signs are the same for left and right hands. With the
metacarpal m, the back of the hand n, the direction r across the palm towards the thumb, perpendicular to m and n, and
the phalanges u, v with the finger's back w, which is perpendicular to u:

    mcp_flexion   = atan2(-u . n, u . m)        mcp_abduction = asin(u . r), of the ring and the little finger -asin
    pip_flexion   = atan2(-v . w, v . u)        dip_flexion likewise

The phalanges are the model's rigid ones, between the joints at which it bends (points.py): PIP and DIP are minus its
angles ``*_pip_rot_x`` and ``*_dip_rot_x``.
"""

from __future__ import annotations

import itertools

import numpy as np

from handpose.body.joint_formats.frames import HandFrames, hand_frames
from handpose.body.joint_formats.points import FINGERS
from handpose.body.sides import Side
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

ANGLES = (
    "thumb_cmc_radial_abduction", "thumb_cmc_palmar_abduction", "thumb_mcp_flexion", "thumb_ip_flexion",
    *(f"{finger}_{angle}" for finger in FINGERS
      for angle in ("mcp_flexion", "mcp_abduction", "pip_flexion", "dip_flexion")),
)


def anatomical_angles(skeleton: Skeleton, hand: Side, xyz: Array) -> dict[str, float]:
    """The angles by name, in degrees, of joints (K, 3) in camera axes. Raises DataError, see ``hand_frames``."""
    return angles_of(hand_frames(skeleton, hand, xyz))


def angles_of(frames: HandFrames) -> dict[str, float]:
    """The angles by name, in degrees, for the directions of a right hand."""
    found = np.zeros(len(ANGLES))
    u, n, m = frames.bones["thumb"][0], frames.dorsal, frames.palm["thumb"]
    found[0] = np.arctan2(u @ _across(m, n), u @ m)
    found[1] = np.arcsin(np.clip(-(u @ n), -1, 1))
    found[2:4] = _bends(frames, "thumb")
    for i, finger in enumerate(FINGERS):
        u, m = frames.bones[finger][0], frames.palm[finger]
        away = -1.0 if finger in ("ring", "little") else 1.0
        found[4 + 4 * i] = np.arctan2(-(u @ n), u @ m)
        found[5 + 4 * i] = away * np.arcsin(np.clip(u @ _across(m, n), -1, 1))
        found[6 + 4 * i : 8 + 4 * i] = _bends(frames, finger)
    return dict(zip(ANGLES, np.degrees(found).tolist()))


def _across(m: Array, n: Array) -> Array:
    """Perpendicular to a metacarpal and the back of the hand, towards the thumb."""
    across = np.cross(m, n)
    return np.asarray(across / np.linalg.norm(across))


def _bends(frames: HandFrames, finger: str) -> list[float]:
    """The angle of each bone of a finger to the one before, towards the palm."""
    bones, back = frames.bones[finger], frames.back[finger]
    bends = []
    for before, after in itertools.pairwise(bones):
        bends.append(float(np.arctan2(-(after @ back), after @ before)))
        back = turned(back, before, after)
    return bends


def turned(vector: Array, before: Array, after: Array) -> Array:
    """A vector turned by the smallest rotation that moves one direction (3,) to another."""
    v, cos = np.cross(before, after), float(before @ after)
    if cos < -0.999999:  # the axis of a half turn is not determined
        return -vector
    return np.asarray(vector * cos + np.cross(v, vector) + v * (v @ vector) / (1 + cos))
