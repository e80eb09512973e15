"""Joints of a hand as other systems define them.

    mediapipe  MediaPipe's 21 hand landmarks: in the image, normalised, and metric. COCO-WholeBody's
               hands, FreiHAND's and the Panoptic Studio's have the same order
    mano       the 16 joints of MANO in its order, then the five fingertips on the skin,
               from the thumb on
    nyu        the 14 joints on which the NYU data set is evaluated, in the order of its papers

# xyz (K, 3) mm, camera axes: of a track, a prediction, a data set
found = formatted("mano", skeleton, "left", xyz)
found.positions
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from handpose.body.joint_formats.frames import LONG_FINGERS, POINTS, Point, joints_of, weights_of
from handpose.body.sides import Side
from handpose.frames.cameras import Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, did_you_mean

FormatName = Literal["mediapipe", "mano", "nyu"]
FORMAT_NAMES: tuple[FormatName, ...] = get_args(FormatName)
METRE = 1000.0
# the joints of each finger, from the palm outwards
PARTS = {"thumb": ("cmc", "mcp", "ip", "tip")}
PARTS |= dict.fromkeys(LONG_FINGERS, ("mcp", "pip", "dip", "tip"))


@dataclass(frozen=True)
class JointFormat:
    """One format.

    joints    names in order, and the point of each
    bones     pairs of names to draw lines between
    unit      of positions: "m" or "mm"
    axes      signs that turn camera axes (x right, y up, z away) into the format's
    in_words  the axes in words
    """

    name: FormatName
    joints: dict[str, Point]
    bones: tuple[tuple[str, str], ...]
    unit: Literal["m", "mm"] = "m"
    axes: tuple[int, int, int] = (1, -1, 1)
    in_words: str = "x right, y down, z away from the camera"


def _points_of(finger: str, names: Sequence[str]) -> dict[str, Point]:
    """The points of the joints of a finger, from the palm outwards, by these names."""
    return {name: POINTS[f"{finger}_{part}"] for name, part in zip(names, PARTS[finger])}


def _mediapipe() -> JointFormat:
    joints = {"WRIST": POINTS["wrist"]}
    bones: list[tuple[str, str]] = []
    for finger, parts in PARTS.items():
        own = {"thumb": "THUMB", "little": "PINKY"}.get(finger, f"{finger.upper()}_FINGER")
        names = [f"{own}_{part.upper()}" for part in parts]
        joints |= _points_of(finger, names)
        bones += itertools.pairwise(names)
    knuckles = [f"{name}_MCP" for name in ("INDEX_FINGER", "MIDDLE_FINGER", "RING_FINGER", "PINKY")]
    bones += [
        ("WRIST", "THUMB_CMC"),
        ("WRIST", knuckles[0]),
        ("WRIST", knuckles[-1]),
        *itertools.pairwise(knuckles),
    ]
    return JointFormat("mediapipe", joints, tuple(bones))


def _mano() -> JointFormat:
    joints = {"wrist": POINTS["wrist"]}
    bones: list[tuple[str, str]] = []
    for finger in ("index", "middle", "little", "ring", "thumb"):
        names = [f"{_pinky(finger)}{i}" for i in (1, 2, 3)]
        joints |= _points_of(finger, names)
        bones += [
            ("wrist", names[0]),
            *itertools.pairwise(names),
            (names[2], f"{_pinky(finger)}_tip"),
        ]
    joints |= {f"{_pinky(finger)}_tip": POINTS[f"{finger}_skin"] for finger in PARTS}
    return JointFormat("mano", joints, tuple(bones))


def _pinky(finger: str) -> str:
    return "pinky" if finger == "little" else finger


def _nyu() -> JointFormat:
    names = [f"{finger}_{part}" for finger in reversed(LONG_FINGERS) for part in ("tip", "pip_a")]
    names += ["thumb_tip", "thumb_dip", "thumb_pip", "wrist_left", "wrist_middle", "palm"]
    distal = "as annotated; of the packaged hand 5 to 8 mm distal"
    joints = {
        name: Point({name: 1}, distal if name.endswith("_pip_a") else "as annotated")
        for name in names
    }
    bones = [(f"{finger}_pip_a", f"{finger}_tip") for finger in LONG_FINGERS]
    bones += [("palm", f"{finger}_pip_a") for finger in LONG_FINGERS]
    bones += [("palm", "wrist_left"), ("palm", "wrist_middle")]
    bones += [("palm", "thumb_pip"), ("thumb_pip", "thumb_dip"), ("thumb_dip", "thumb_tip")]
    return JointFormat(
        "nyu", joints, tuple(bones), "mm", (1, 1, 1), "x right, y up, z away from the camera"
    )


FORMATS: dict[FormatName, JointFormat] = {one.name: one for one in (_mediapipe(), _mano(), _nyu())}


@dataclass(frozen=True)
class FormattedHand:
    """A hand in a format.

    format        with the names of the J joints
    positions     (J, 3) in its unit and axes, from the origin of the given joints: for a
                  track the camera
    landmarks     (J, 3) of mediapipe, if a camera or a cube is given: x and y in [0, 1] of the
                  image's width and height, z behind the wrist in widths of the image;
                  otherwise None
    """

    format: JointFormat
    positions: Array
    landmarks: Array | None


def formatted(
    name: FormatName,
    skeleton: Skeleton,
    hand: Side,
    xyz: Array,
    camera: Camera | None = None,
    cube_mm: float | None = None,
) -> FormattedHand:
    """A hand in a format.

    Raises DataError for another body than a hand, an unknown format, joints that are not finite,
    and landmarks of a hand that is not before the camera.

    xyz      (K, 3) joints of the skeleton in mm, camera axes
    camera   that saw it, for landmarks in the image
    cube_mm  of a crop without its frame: landmarks are in the crop then
    """
    if name not in FORMATS:
        raise DataError(
            f"format {name!r}{did_you_mean(str(name), FORMATS)}; expected {', '.join(FORMATS)}"
        )
    chosen = FORMATS[name]
    xyz = joints_of(skeleton, hand, xyz)
    points = _weights(name, skeleton) @ xyz
    scale = np.array(chosen.axes) / (METRE if chosen.unit == "m" else 1.0)
    landmarks = _landmarks(points, camera, cube_mm) if name == "mediapipe" else None
    return FormattedHand(chosen, points * scale, landmarks)


@functools.lru_cache(maxsize=16)
def _weights(name: FormatName, skeleton: Skeleton) -> Array:
    """The weights (J, K) of the skeleton's joints for those of a format."""
    return weights_of(list(FORMATS[name].joints.values()), skeleton)


def _landmarks(points: Array, camera: Camera | None, cube_mm: float | None) -> Array | None:
    """MediaPipe's landmarks of points (J, 3), the wrist first; the corner of the image is half a
    pixel before 0.
    """
    x, y, z = points.T
    if camera is not None and camera.width:
        if not z.min() > 0:
            raise DataError(
                f"a joint at depth {z.min():g} mm is not in the image; expected joints before the camera"
            )
        u, v, d = camera.project(points).T
        behind = (d - d[0]) / d[0] * camera.fx
        across, down = (u + 0.5) / camera.width, (v + 0.5) / camera.height
        return np.stack([across, down, behind / camera.width], axis=1)
    if cube_mm is None:
        return None
    across, down = 0.5 + x / cube_mm, 0.5 - y / cube_mm
    return np.stack([across, down, (z - z[0]) / cube_mm], axis=1)
