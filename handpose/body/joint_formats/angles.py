"""Anatomical angles of a hand, computed from its joints. In degrees:

    FINGER_mcp_flexion     of the first phalanx from the line of its metacarpal towards the palm;
                           extension is negative
    FINGER_mcp_abduction   of the first phalanx away from the middle finger, in the plane of
                           the palm; adduction is negative. Of the middle finger: towards
                           the index finger
    FINGER_pip_flexion     between the first and the second phalanx, towards the palm
    FINGER_dip_flexion     between the second and the third one
    thumb_cmc_radial_abduction   of the metacarpal away from that of the index finger, in the
                                 plane of the palm
    thumb_cmc_palmar_abduction   of the metacarpal out of the plane of the palm, to the
                                 side of the palm
    thumb_mcp_flexion, thumb_ip_flexion   between the bones of the thumb, towards the fingers

A straight finger in line with its metacarpal has only zeros. Signs are the same for left and right
hands. With the metacarpal m, the back of the hand n, the direction r across the palm towards the
thumb, perpendicular to m and n, and the phalanges u, v with the finger's back w, which is
perpendicular to u:

    mcp_flexion   = atan2(-u . n, u . m)
    mcp_abduction = asin(u . r), of the ring and the little finger -asin
    pip_flexion   = atan2(-v . w, v . u)        dip_flexion likewise

The phalanges are the model's rigid ones, between the joints at which it bends: PIP and DIP are
minus its angles ``*_pip_rot_x`` and ``*_dip_rot_x``. They depend on positions only, so joints of a
network, a fit or a track can be used.

The palm is rigid in the model. Its rotation (``frames.palm_frame``) fixes the frame of each knuckle
M = world_from_mcp. The first phalanx has the direction

    d = M Rz(a) Rx(b) e_y,    Rz(a) Rx(b) e_y = (-sin a cos b, cos a cos b, sin b)

which determines a and b, because a finger spreads by less than MAX_SPREAD from the middle of its
range: one that is bent by more than 90 degrees points backwards. So the axis M Rz(a) e_x, about
which the finger bends, is known for straight fingers, too, but not at exactly 90 degrees. The thumb
bends about z and points along x: d = M Rz(a) Ry(-b) e_x.
"""

from __future__ import annotations

import functools
import itertools
from typing import NamedTuple

import numpy as np

from handpose.body.joint_formats.frames import (
    LONG_FINGERS,
    POINTS,
    hinges_of,
    joints_of,
    palm_frame,
    weights_of,
)
from handpose.body.sides import Side, mirror_of
from layers.hand.kinematics import Kinematics, rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

ANGLES = (
    "thumb_cmc_radial_abduction",
    "thumb_cmc_palmar_abduction",
    "thumb_mcp_flexion",
    "thumb_ip_flexion",
    *(
        f"{finger}_{angle}"
        for finger in LONG_FINGERS
        for angle in ("mcp_flexion", "mcp_abduction", "pip_flexion", "dip_flexion")
    ),
)
# of a finger from the middle of its range; near 90 degrees of bend noise decides the rest
MAX_SPREAD = np.radians(60)
MIN_PALM_MM = 1e-3
# minimum length of a bone relative to the palm, and sine of an angle between two directions
MIN_SHARE = 1e-6


def anatomical_angles(skeleton: Skeleton, hand: Side, xyz: Array) -> dict[str, float]:
    """The angles by name, in degrees, of joints (K, 3) in camera axes.

    Raises DataError for other bodies than hands, joints that are not finite, and degenerate hands:
    joints of the palm on a line or at one point, bones without a length, or a metacarpal
    perpendicular to the palm.
    """
    right = joints_of(skeleton, hand, xyz) * mirror_of(hand)
    R = palm_frame(right, skeleton)
    rest = _rest(skeleton)
    palm = _palm_of(rest.points @ right)
    found: list[float] = []
    for finger, m in zip(("thumb", *LONG_FINGERS), (palm.metacarpals[0], *palm.metacarpals)):
        bones = _bones_of(finger, right[rest.hinges[finger]], palm.size)
        M = R @ rest.frames[finger]
        u = bones[0]
        d = M.T @ u
        r = np.cross(m, palm.dorsal)
        r = r / np.linalg.norm(r)
        if finger == "thumb":
            a = np.arctan2(d[1], d[0])
            back = M @ rotation(2, a)[:, 1] * -1
            radial = np.arctan2(u @ r, u @ m)
            palmar = np.arcsin(np.clip(-(u @ palm.dorsal), -1, 1))
            found += [radial, palmar]
        else:
            a, b = _spread_and_bend(d, rest.ahead[finger])
            back = M @ (rotation(2, a) @ rotation(0, b))[:, 2]
            away = -1.0 if finger in ("ring", "little") else 1.0
            flexion = np.arctan2(-(u @ palm.dorsal), u @ m)
            radial = np.arcsin(np.clip(u @ r, -1, 1))
            found += [flexion, away * radial]
        found += _bends(bones, back)
    return dict(zip(ANGLES, np.degrees(found).tolist()))


class _Palm(NamedTuple):
    """The palm of a hand: directions from its back and along the metacarpals of the long fingers,
    and the shorter of two sides.
    """

    dorsal: Array
    metacarpals: list[Array]
    size: float


def _palm_of(points: Array) -> _Palm:
    """The palm by the wrist, then the ends of every metacarpal. Raises DataError."""
    wrist, cmc, mcp = points[0], points[1::2], points[2::2]
    sides = mcp[[0, -1]] - wrist
    across = np.cross(*sides)
    size = float(np.linalg.norm(sides, axis=1).min())
    if size < MIN_PALM_MM or not float(np.linalg.norm(across)) > MIN_SHARE * size**2:
        raise DataError(
            "the wrist and the knuckles of index and little finger are on a line; expected a palm"
        )
    dorsal = _unit(across)
    metacarpals = [_unit(b - a) for a, b in zip(cmc, mcp)]
    if not np.linalg.norm(np.cross(metacarpals, dorsal), axis=1).min() > MIN_SHARE:
        raise DataError(
            "a metacarpal has no length or is perpendicular to the palm; expected a hand"
        )
    return _Palm(dorsal, metacarpals, size)


def _bones_of(finger: str, ends: Array, palm_size: float) -> Array:
    """The directions (3, 3) of the phalanges between these ends (4, 3). Raises DataError."""
    phalanges = ends[1:] - ends[:-1]
    lengths = np.linalg.norm(phalanges, axis=1)
    if not lengths.min() > MIN_SHARE * palm_size:
        raise DataError(
            f"a bone of the {finger} has no length; expected joints at different positions"
        )
    return phalanges / lengths[:, None]


class _Rest(NamedTuple):
    frames: dict[str, Array]
    ahead: dict[str, float]  # angle about z of the first phalanx in the middle of its range
    hinges: dict[str, list[int]]
    points: Array


@functools.lru_cache(maxsize=8)
def _rest(skeleton: Skeleton) -> _Rest:
    """What a skeleton's initial pose gives, in the axes of its palm."""
    names = ["wrist", *(f"{finger}_{part}" for finger in LONG_FINGERS for part in ("cmc", "mcp"))]
    points = weights_of([POINTS[name] for name in names], skeleton)
    hinges = hinges_of(skeleton)
    kinematics = Kinematics(skeleton)
    pose = kinematics.forward(np.zeros((1, len(skeleton.initial))))
    middle = kinematics.forward(
        np.clip([skeleton.lower, skeleton.upper], -np.pi, np.pi).mean(axis=0, keepdims=True)
    )
    root = pose.frames[0, skeleton.joint_names.index("palm")]
    ahead = {}
    for finger, (knuckle, next_joint, *_) in hinges.items():
        phalanx = middle.joints[0, next_joint] - middle.joints[0, knuckle]
        x, y, _ = middle.frames[0, knuckle].T @ phalanx
        ahead[finger] = float(np.arctan2(-x, y))
    frames = {finger: root.T @ pose.frames[0, own[0]] for finger, own in hinges.items()}
    return _Rest(frames, ahead, hinges, points)


def _spread_and_bend(d: Array, ahead: float) -> tuple[float, float]:
    """The angles about z and then x that turn y to d (3,), the first within
    MAX_SPREAD of ``ahead``.
    """
    x, y = rotation(2, ahead)[:2, :2].T @ d[:2]
    forward = 1.0 if y >= 0 else -1.0
    spread = float(np.clip(np.arctan2(-forward * x, forward * y), -MAX_SPREAD, MAX_SPREAD))
    return ahead + spread, float(np.arctan2(d[2], forward * np.hypot(x, y)))


def _unit(vector: Array) -> Array:
    """A vector (3,) scaled to length 1; 0 stays 0."""
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _bends(bones: Array, back: Array) -> list[float]:
    """The angle of each bone (3, 3) of a finger to the one before, towards the palm; the ``back``
    is of the first.
    """
    bends = []
    for before, after in itertools.pairwise(bones):
        bends.append(float(np.arctan2(-(after @ back), after @ before)))
        back = turned(back, before, after)
    return bends


def turned(vector: Array, before: Array, after: Array) -> Array:
    """A vector turned by the smallest rotation that moves one direction (3,) to another."""
    v = np.cross(before, after)
    cos = float(before @ after)
    if cos < -0.999999:  # the axis of a half turn is not determined
        return -vector
    along_axis = v * (v @ vector) / (1 + cos)
    return vector * cos + np.cross(v, vector) + along_axis
