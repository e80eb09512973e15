"""Points of a right hand, and the rotation of its palm, computed from its joints.

A point is a weighted mean of the skeleton's joints; weights sum to 1, so points move, turn, scale
and mirror with the hand. A finger has six joints, which are named after NYU's annotation points.
The fingers of ``people.prototxt`` bend at ``mcp``, ``pip_a`` and ``dip``, which are the
anatomical joints:

    mcp .... base ...... pip_a . pip_b .... dip .... tip
    |----- proximal -----|---- middle -----|- distal -|

``base`` is NYU's point on the proximal phalanx, ``pip_b`` a point 6 mm beyond the PIP joint. NYU
annotates two points for every phalanx, near its ends, and the fingers of ``nyu.prototxt`` bend at
the first ones, ``mcp``, ``base`` and ``pip_b``:

    mcp .... base .. pip_a .... pip_b .. dip .... tip
    |- proximal -|   |- middle -|   |- distal -|

There the PIP joint is between ``base`` and ``pip_a``, the DIP joint between ``pip_b`` and ``dip``;
the weights were chosen from the proportions of adult phalanges.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.sides import SIDES, Side
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, reason_of

NO_JOINT = "the skeleton has no joint {!r}; only hands have joints and angles of other formats"
LONG_FINGERS = ("index", "middle", "ring", "little")
# share of wrist_middle; wrist_left the rest
PALM_BONES = {"index": 0.75, "middle": 0.58, "ring": 0.42, "little": 0.25}
CARPALS = 0.3  # position between wrist (0) and knuckle (1)
# last radius / last bone
SKIN = {"thumb": 0.39, "index": 0.58, "middle": 0.53, "ring": 0.55, "little": 0.57}
NYU_SKIN = {"thumb": 0.39, "index": 0.62, "middle": 0.48, "ring": 0.52, "little": 0.64}
MAX_MM = 1e6  # of joints; larger numbers are in another unit, or no positions


class Point(NamedTuple):
    """A point of the hand.

    weights  of the skeleton's joints, by name
    bias     position relative to the anatomical point: distal is towards the fingertip, dorsal
             towards the back of the hand, palmar away from it
    nyu      weights for a skeleton that bends at NYU's annotation points; by default the same
    """

    weights: dict[str, float]
    bias: str
    nyu: dict[str, float] | None = None


def _points() -> dict[str, Point]:
    found = {
        "wrist": Point(
            {"wrist_left": 0.5, "wrist_middle": 0.5}, "9 mm dorsal of the middle of the wrist"
        ),
        "thumb_cmc": Point(
            {"thumb_mcp": 1}, "by the bones' proportions up to 15 mm distal; 8 mm dorsal"
        ),
        "thumb_mcp": Point(
            {"thumb_pip": 0.85, "thumb_dip": 0.15},
            "2 mm proximal, 3 mm palmar; the hinge is 7 mm proximal",
        ),
        "thumb_ip": Point({"thumb_dip": 1}, "2 mm distal, 2 mm palmar"),
        "thumb_tip": Point({"thumb_tip": 1}, "2 mm distal; 9 mm before the end of the thumb"),
        "thumb_skin": Point(_beyond("thumb", SKIN), "the end of the thumb in the surface model"),
    }
    for finger in LONG_FINGERS:
        radial = PALM_BONES[finger]
        base = 1 - CARPALS
        cmc = {
            "wrist_middle": base * radial,
            "wrist_left": base * (1 - radial),
            f"{finger}_mcp": CARPALS,
        }
        pip = {f"{finger}_base": 0.3, f"{finger}_pip_a": 0.7}
        dip = {f"{finger}_pip_b": 0.6, f"{finger}_dip": 0.4}
        found |= {
            f"{finger}_cmc": Point(
                cmc, "a fixed proportion of the palm, not observable; 8 mm dorsal"
            ),
            f"{finger}_mcp": Point({f"{finger}_mcp": 1}, "2 mm distal, 4 mm dorsal"),
            f"{finger}_pip": Point({f"{finger}_pip_a": 1}, "5 mm distal, 1 mm dorsal", pip),
            f"{finger}_dip": Point({f"{finger}_dip": 1}, "5 mm distal", dip),
            f"{finger}_tip": Point(
                {f"{finger}_tip": 1}, "3 mm distal; 9 mm before the end of the finger"
            ),
            f"{finger}_skin": Point(
                _beyond(finger, SKIN),
                "the end of the finger in the surface model",
                _beyond(finger, NYU_SKIN),
            ),
        }
    return found


def _beyond(finger: str, skin: dict[str, float]) -> dict[str, float]:
    """The end of a fingertip, its radius beyond the last joint."""
    return {f"{finger}_tip": 1 + skin[finger], f"{finger}_dip": -skin[finger]}


POINTS = _points()


def hinges_of(skeleton: Skeleton) -> dict[str, list[int]]:
    """By finger the joints at which it bends, from the knuckle outwards, and its tip: the ends of
    its rigid phalanges.

    Raises DataError for another body than a hand.
    """
    index = {name: i for i, name in enumerate(skeleton.joint_names)}
    found = {}
    for finger in ("thumb", *LONG_FINGERS):
        for name in (f"{finger}_mcp", f"{finger}_tip"):
            if name not in index:
                raise DataError(NO_JOINT.format(name))
        joint = index[f"{finger}_tip"]
        ends = [joint]
        while joint not in (index[f"{finger}_mcp"], -1):
            if skeleton.motions[joint]:
                ends.append(int(skeleton.parents[joint]))
            joint = int(skeleton.parents[joint])
        if len(ends) != 4 or joint < 0:
            raise DataError(
                f"skeleton {skeleton.name!r}: {finger} bends at {len(ends) - 1} joints; expected 3"
            )
        found[finger] = ends[::-1]
    return found


def weights_of(points: Sequence[Point], skeleton: Skeleton) -> Array:
    """Weights (P, K) that turn the joints of a skeleton into points.

    Raises DataError for another body than a hand.
    """
    names = skeleton.joint_names
    index = {name: i for i, name in enumerate(names)}
    annotated = names[hinges_of(skeleton)["index"][1]] == "index_base"
    weights = np.zeros((len(points), len(index)))
    for row, point in enumerate(points):
        for joint, weight in (point.nyu if annotated and point.nyu else point.weights).items():
            if joint not in index:
                raise DataError(NO_JOINT.format(joint))
            weights[row, index[joint]] = weight
    return weights


def joints_of(skeleton: Skeleton, hand: Side, xyz: ArrayLike) -> Array:
    """Joints (K, 3) in mm as float64.

    Raises DataError for another shape or side, and numbers that are not finite.
    """
    if hand not in SIDES:
        raise DataError(f"hand {hand!r}; expected {' or '.join(SIDES)}")
    try:
        found = np.asarray(xyz, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"joints are not numbers: {reason_of(error)}") from None
    if found.shape != (expected := (len(skeleton.joint_names), 3)):
        raise DataError(
            f"joints of shape {found.shape}; expected {expected}, those of skeleton {skeleton.name!r}"
        )
    bad = ~(np.abs(found) <= MAX_MM).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise DataError(
            f"joint {skeleton.joint_names[first]!r} at {found[first].tolist()}; expected finite numbers "
            f"of mm, at most {MAX_MM:g}"
        )
    return found


def palm_frame(joints: Array, skeleton: Skeleton) -> Array:
    """The rotation of the palm, world_from_palm (3, 3), for joints (K, 3).

    It is the rotation R that best moves the joints fixed to the palm from their positions p_k in
    its frame to those given: it minimises sum_k |x_k - R p_k|², with x_k from the palm. With the
    decomposition sum_k x_k p_kᵀ = U S Vᵀ

        R = U diag(1, 1, det(U Vᵀ)) Vᵀ        (Kabsch, 1976)

    Raises DataError if the skeleton has too few such joints.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(NO_JOINT.format("palm"))
    joints = joints_of(skeleton, "right", joints)
    fixed, in_palm = _fixed_to_palm(skeleton)
    from_palm = joints[fixed] - joints[skeleton.joint_names.index("palm")]
    U, _, Vt = np.linalg.svd(from_palm.T @ in_palm)
    return U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt


@functools.lru_cache(maxsize=16)
def _fixed_to_palm(skeleton: Skeleton) -> tuple[NDArray[np.int_], Array]:
    """The joints that move with the palm only, and their positions (n, 3) from it in its frame."""
    palm = skeleton.joint_names.index("palm")
    fixed = np.flatnonzero((skeleton.moves == skeleton.moves[:, [palm]]).all(axis=0))
    kinematics = kinematics_of(skeleton)
    pose = kinematics.forward(np.zeros((1, len(skeleton.initial))))
    in_palm = (pose.joints[0, fixed] - pose.joints[0, palm]) @ kinematics.rotation_of(pose, palm)[0]
    if np.linalg.matrix_rank(in_palm) < 2:
        raise DataError(
            f"skeleton {skeleton.name!r} has too few joints fixed to the palm to tell how it is turned"
        )
    return fixed, in_palm
