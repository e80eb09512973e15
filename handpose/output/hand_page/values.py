"""The data of a hand page as JSON values: bodies, and predicted hands.

Lengths are in half-cubes, angles in radians, unless they say mm:

bodies    to choose from; the page opens with the first one
    name      in the list and in addresses
    skeleton  as in ``skeleton_values``
    place     unit_mm (of a length of 1), camera, center_uvd (px, px, mm) and cube_mm of the crop
    poses     by name: inputs by DoF
cameras   to choose from: name, fx, fy, u0, v0, width, height
hands     predicted hands to choose from, all with the first body's skeleton; if there are any, the
          page opens with one
    name, words      of the frame; description of the hand
    place            as above
    inputs           of the whole body, including the DoFs of its surface; for a left hand those of
                     its mirror image
    size, thickness  scale of bones, offsets and radii; of the radii alone
    side             "right" or "left"
    crop             16-bit numbers in base64: the crop, -1 to 1 in steps of 1/32767
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.model import Surface
from handpose.body.nyu import CUBE_MM
from handpose.body.sides import Side
from handpose.frames.cameras import NYU, Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

# of a hand without a frame, on the camera's axis; for other bodies in proportion to their size
DISTANCE_MM = 700.0
FULL = 32767  # the largest 16-bit number
# larger limits are written as none; the packaged hands have limits of 10000 for free DoFs
MAX_LIMIT = 1000.0

Poses = Mapping[str, Mapping[str, float]]


def body(
    name: str, skeleton: Skeleton, poses: Poses | None = None, unit_mm: float = CUBE_MM / 2
) -> dict[str, Any]:
    """A body that a page offers, in the middle of NYU's image.

    Raises PrototxtError for an invalid surface.
    """
    cube_mm = 2 * unit_mm
    middle = np.array([NYU.u0, NYU.v0, DISTANCE_MM * max(1.0, cube_mm / CUBE_MM)])
    return {
        "name": name,
        "skeleton": skeleton_values(skeleton),
        "place": _place(NYU, middle, cube_mm),
        "poses": dict(poses or {}),
    }


def skeleton_values(skeleton: Skeleton) -> dict[str, Any]:
    """A skeleton with its surface as JSON values. Joints and DoFs are referred to by their index.

    own, whole  the skeleton; the same, followed by the joints and DoFs of its surface alone,
                such as an arm:
        name
        joints   names in output order
        parents, bones, bone_axes  by joint: its parent, or -1; length with a sign; axis 0, 1, 2, or
                                   -1 without a bone
        motions  by joint, in the order of application: turns (else it translates), axis, sign
                 (1 or -1), dof
        dofs     names
        initial, lower, upper, fixed  by DoF: added to the input; its limits, null without;
                                      whether it is ignored
    capsules    from and to (joints), radii at both; the edges of wedges first; null for a body
                without a surface
    offsets     joint, axes (a joint), vector: capsules that end at ``joint`` are displaced by the
                vector along the axes of the other joint

    Raises PrototxtError for an invalid surface.
    """
    own = _columns(skeleton)
    if skeleton.param.flesh is None:
        return {"own": own, "whole": own, "capsules": None, "offsets": []}
    surface = Surface(skeleton)
    each = zip(surface.start.tolist(), surface.end.tolist(), surface.radii.tolist())
    capsules = [{"from": start, "to": end, "radii": radii} for start, end, radii in each]
    offsets = [
        {"joint": joint, "axes": axes, "vector": vector}
        for axes, (at, vectors) in surface.offsets.items()
        for joint, vector in zip(at.tolist(), vectors.tolist())
    ]
    return {"own": own, "whole": _columns(surface.whole), "capsules": capsules, "offsets": offsets}


def _columns(skeleton: Skeleton) -> dict[str, Any]:
    def limits(values: Array) -> list[float | None]:
        return [value if abs(value) <= MAX_LIMIT else None for value in values.tolist()]

    motions = [
        [{"turns": m.kind == "rotate", "axis": m.axis, "sign": m.sign, "dof": m.dof} for m in own]
        for own in skeleton.motions
    ]
    return {
        "name": skeleton.name,
        "joints": skeleton.joint_names,
        "parents": skeleton.parents.tolist(),
        "bones": skeleton.bones.tolist(),
        "bone_axes": skeleton.bone_axes.tolist(),
        "motions": motions,
        "dofs": skeleton.dof_names,
        "initial": skeleton.initial.tolist(),
        "lower": limits(skeleton.lower),
        "upper": limits(skeleton.upper),
        "fixed": skeleton.fixed.tolist(),
    }


def hand(
    name: str,
    words: str,
    inputs: ArrayLike,
    *,
    camera: Camera,
    center_uvd: Array,
    cube_mm: float,
    crop: NDArray[np.floating],
    size: float = 1.0,
    thickness: float = 1.0,
    side: Side = "right",
) -> dict[str, Any]:
    """A hand predicted in a crop (S, S) in [-1, 1].

    inputs  of the skeleton, or of the whole body; missing ones are 0
    """
    whole = np.rint(crop * FULL).astype("<i2")
    packed = base64.b64encode(whole.tobytes()).decode("ascii")
    return {
        "name": name,
        "words": words,
        "place": _place(camera, center_uvd, cube_mm),
        "side": side,
        "size": size,
        "thickness": thickness,
        "inputs": np.asarray(inputs, dtype=np.float64).tolist(),
        "crop": packed,
    }


def _place(camera: Camera, center_uvd: ArrayLike, cube_mm: float) -> dict[str, Any]:
    middle = np.asarray(center_uvd, dtype=np.float64).tolist()
    return {
        "unit_mm": cube_mm / 2,
        "camera": vars(camera),
        "center_uvd": middle,
        "cube_mm": cube_mm,
    }
