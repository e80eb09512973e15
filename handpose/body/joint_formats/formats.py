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
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from handpose.body.joint_formats.frames import POINTS, Point, joints_of, weights_of
from handpose.body.sides import Side
from handpose.frames.cameras import Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, did_you_mean

FormatName = Literal["mediapipe", "mano", "nyu"]
FORMAT_NAMES: tuple[FormatName, ...] = get_args(FormatName)
METRE = 1000.0


@dataclass(frozen=True)
class JointFormat:
    """One format.

    joints   names in order, and the point of each
    bones    pairs of names to draw lines between
    unit     of positions: "m" or "mm"
    up       sign of y: camera axes are x right, y up, z away
    """

    joints: dict[str, Point]
    bones: tuple[tuple[str, str], ...]
    unit: Literal["m", "mm"] = "m"
    up: Literal[1, -1] = -1

    @property
    def in_words(self) -> str:
        """The axes in words."""
        return f"x right, y {'up' if self.up > 0 else 'down'}, z away from the camera"


# Joints in order, with the point of each; those of NYU are joints of the skeleton.
MEDIAPIPE_JOINTS = """\
WRIST wrist
THUMB_CMC thumb_cmc
THUMB_MCP thumb_mcp
THUMB_IP thumb_ip
THUMB_TIP thumb_tip
INDEX_FINGER_MCP index_mcp
INDEX_FINGER_PIP index_pip
INDEX_FINGER_DIP index_dip
INDEX_FINGER_TIP index_tip
MIDDLE_FINGER_MCP middle_mcp
MIDDLE_FINGER_PIP middle_pip
MIDDLE_FINGER_DIP middle_dip
MIDDLE_FINGER_TIP middle_tip
RING_FINGER_MCP ring_mcp
RING_FINGER_PIP ring_pip
RING_FINGER_DIP ring_dip
RING_FINGER_TIP ring_tip
PINKY_MCP little_mcp
PINKY_PIP little_pip
PINKY_DIP little_dip
PINKY_TIP little_tip
"""
MANO_JOINTS = """\
wrist wrist
index1 index_mcp
index2 index_pip
index3 index_dip
middle1 middle_mcp
middle2 middle_pip
middle3 middle_dip
pinky1 little_mcp
pinky2 little_pip
pinky3 little_dip
ring1 ring_mcp
ring2 ring_pip
ring3 ring_dip
thumb1 thumb_cmc
thumb2 thumb_mcp
thumb3 thumb_ip
thumb_tip thumb_skin
index_tip index_skin
middle_tip middle_skin
ring_tip ring_skin
pinky_tip little_skin
"""
NYU_JOINTS = """\
little_tip
little_pip_a
ring_tip
ring_pip_a
middle_tip
middle_pip_a
index_tip
index_pip_a
thumb_tip
thumb_dip
thumb_pip
wrist_left
wrist_middle
palm
"""
# Each line: the numbers of joints with a bone between every two neighbours.
MEDIAPIPE_BONES = """\
1 2 3 4
5 6 7 8
9 10 11 12
13 14 15 16
17 18 19 20
0 1
0 5
0 17
5 9 13 17
"""
MANO_BONES = """\
0 1 2 3 17
0 4 5 6 18
0 7 8 9 20
0 10 11 12 19
0 13 14 15 16
"""
NYU_BONES = """\
7 6
5 4
3 2
1 0
13 7
13 5
13 3
13 1
13 11
13 12
13 10 9 8
"""


def _format(
    joints: str, bones: str, unit: Literal["m", "mm"] = "m", up: Literal[1, -1] = -1
) -> JointFormat:
    """The format of two tables."""
    points = {
        joint: POINTS[point[0]] if point else _annotated(joint)
        for joint, *point in map(str.split, joints.splitlines())
    }
    names = list(points)
    chains = ([names[int(number)] for number in line.split()] for line in bones.splitlines())
    pairs = itertools.chain(*map(itertools.pairwise, chains))
    return JointFormat(points, tuple(pairs), unit, up)


def _annotated(joint: str) -> Point:
    """A joint of the skeleton, as NYU annotates it."""
    moved = "; of the packaged hand 5 to 8 mm distal" if joint.endswith("_pip_a") else ""
    return Point({joint: 1}, f"as annotated{moved}")


FORMATS: dict[FormatName, JointFormat] = {
    "mediapipe": _format(MEDIAPIPE_JOINTS, MEDIAPIPE_BONES),
    "mano": _format(MANO_JOINTS, MANO_BONES),
    "nyu": _format(NYU_JOINTS, NYU_BONES, "mm", 1),
}


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
    scale = np.array([1, chosen.up, 1]) / (METRE if chosen.unit == "m" else 1.0)
    landmarks = _landmarks(points, camera, cube_mm) if name == "mediapipe" else None
    return FormattedHand(chosen, points * scale, landmarks)


@functools.lru_cache(maxsize=16)
def _weights(name: FormatName, skeleton: Skeleton) -> Array:
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
