"""The joint formats: their points, order, unit and axes, and their other outputs.

    mediapipe  MediaPipe's 21 hand landmarks: in the image, normalised, and metric. COCO-WholeBody's hands, FreiHAND's
               and the Panoptic Studio's have the same order
    openxr     the 26 joints of OpenXR's hand tracking, each with an orientation and a radius
    mano       the 16 joints of MANO in its order, then the five fingertips on the skin, from the thumb on
    nyu        the 14 joints on which the NYU data set is evaluated, in the order of its papers

found = formatted("openxr", skeleton, "left", xyz)  # xyz (K, 3) mm, camera axes: of a track, a prediction, a data set
found.positions, found.orientations, found.radii
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy

from handpose.body.joint_formats.angles import turned
from handpose.body.joint_formats.frames import MIN_SHARE, HandFrames, hand_frames, joints_of, unit
from handpose.body.joint_formats.points import FINGERS, POINTS, Point, weights_of
from handpose.body.model import Surface
from handpose.body.sides import Side, mirror_of
from handpose.frames.cameras import Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, did_you_mean

FormatName = Literal["mediapipe", "openxr", "mano", "nyu"]
FORMAT_NAMES: tuple[FormatName, ...] = get_args(FormatName)
METRE = 1000.0


@dataclass(frozen=True)
class JointFormat:
    """One format.

    joints   names in order, and the point of each
    bones    pairs of names to draw lines between
    unit     of positions: "m" or "mm"
    axes     signs that turn camera axes (x right, y up, z away) into the format's
    in_words of the axes
    """

    name: FormatName
    joints: dict[str, Point]
    bones: tuple[tuple[str, str], ...]
    unit: Literal["m", "mm"]
    axes: tuple[int, int, int]
    in_words: str


def _mediapipe() -> JointFormat:
    joints = {"WRIST": POINTS["wrist"]}
    bones: list[tuple[str, str]] = []
    for finger in ("thumb", *FINGERS):
        own = {"thumb": "THUMB", "little": "PINKY"}.get(finger, f"{finger.upper()}_FINGER")
        parts = ("cmc", "mcp", "ip", "tip") if finger == "thumb" else ("mcp", "pip", "dip", "tip")
        names = [f"{own}_{part.upper()}" for part in parts]
        joints |= dict(zip(names, (POINTS[f"{finger}_{part}"] for part in parts)))
        bones += itertools.pairwise(names)
    knuckles = [f"{name}_MCP" for name in ("INDEX_FINGER", "MIDDLE_FINGER", "RING_FINGER", "PINKY")]
    bones += [("WRIST", "THUMB_CMC"), ("WRIST", knuckles[0]), ("WRIST", knuckles[-1]), *itertools.pairwise(knuckles)]
    return JointFormat("mediapipe", joints, tuple(bones), "m", (1, -1, 1), "x right, y down, z away from the camera")


def _openxr() -> JointFormat:
    joints, bones = {"PALM": POINTS["palm_middle"], "WRIST": POINTS["wrist"]}, [("WRIST", "PALM")]
    for finger in ("thumb", *FINGERS):
        parts = {"METACARPAL": "cmc", "PROXIMAL": "mcp", "INTERMEDIATE": "pip", "DISTAL": "dip", "TIP": "tip"}
        if finger == "thumb":
            parts = {"METACARPAL": "cmc", "PROXIMAL": "mcp", "DISTAL": "ip", "TIP": "tip"}
        names = [f"{finger.upper()}_{part}" for part in parts]
        joints |= dict(zip(names, (POINTS[f"{finger}_{point}"] for point in parts.values())))
        bones += [("WRIST", names[0]), *itertools.pairwise(names)]
    return JointFormat("openxr", joints, tuple(bones), "m", (1, 1, -1), "x right, y up, z towards the camera")


def _mano() -> JointFormat:
    joints = {"wrist": POINTS["wrist"]}
    bones: list[tuple[str, str]] = []
    for finger in ("index", "middle", "little", "ring", "thumb"):
        parts = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
        names = [f"{_pinky(finger)}{i}" for i in (1, 2, 3)]
        joints |= dict(zip(names, (POINTS[f"{finger}_{part}"] for part in parts)))
        bones += [("wrist", names[0]), *itertools.pairwise(names), (names[2], f"{_pinky(finger)}_tip")]
    joints |= {f"{_pinky(finger)}_tip": POINTS[f"{finger}_skin"] for finger in ("thumb", *FINGERS)}
    return JointFormat("mano", joints, tuple(bones), "m", (1, -1, 1), "x right, y down, z away from the camera")


def _pinky(finger: str) -> str:
    return "pinky" if finger == "little" else finger


def _nyu() -> JointFormat:
    names = [f"{finger}_{part}" for finger in reversed(FINGERS) for part in ("tip", "pip_a")]
    names += ["thumb_tip", "thumb_dip", "thumb_pip", "wrist_left", "wrist_middle", "palm"]
    moved = "as annotated; of the packaged hand 5 to 8 mm distal"
    joints = {name: Point({name: 1}, moved if name.endswith("_pip_a") else "as annotated") for name in names}
    bones = [(f"{finger}_pip_a", f"{finger}_tip") for finger in FINGERS]
    bones += [("palm", f"{finger}_pip_a") for finger in FINGERS] + [("palm", "wrist_left"), ("palm", "wrist_middle")]
    bones += [("palm", "thumb_pip"), ("thumb_pip", "thumb_dip"), ("thumb_dip", "thumb_tip")]
    return JointFormat("nyu", joints, tuple(bones), "mm", (1, 1, 1), "x right, y up, z away from the camera")


FORMATS: dict[FormatName, JointFormat] = {one.name: one for one in (_mediapipe(), _openxr(), _mano(), _nyu())}


@dataclass(frozen=True)
class FormattedHand:
    """A hand in a format.

    format        with the names of the J joints
    positions     (J, 3) in its unit and axes, from the origin of the given joints: for a track the camera
    orientations  (J, 4) quaternions x, y, z, w, w >= 0, of openxr: -Z along the bone to the fingertip, +Y out of the
                  back of the hand or the nail, +X to the right of both; otherwise None
    radii         (J,) of openxr, in m: from the joint to the skin; otherwise None
    landmarks     (J, 3) of mediapipe, if a camera or a cube is given: x and y in [0, 1] of the image's width and
                  height, z behind the wrist in widths of the image; otherwise None
    """

    format: JointFormat
    positions: Array
    orientations: Array | None = None
    radii: Array | None = None
    landmarks: Array | None = None

    @property
    def center(self) -> Array:
        """(3,) the mean of all joints, about which MediaPipe's world landmarks are."""
        return np.asarray(self.positions.mean(axis=0))

    @property
    def world_landmarks(self) -> Array:
        """(J, 3) positions about ``center``."""
        return np.asarray(self.positions - self.center)


def formatted(
    name: FormatName,
    skeleton: Skeleton,
    hand: Side,
    xyz: Array,
    camera: Camera | None = None,
    cube_mm: float | None = None,
    frames: HandFrames | None = None,
) -> FormattedHand:
    """A hand in a format.

    Raises DataError for another body than a hand, an unknown format, joints that are not finite, landmarks of a hand
    that is not before the camera, and a degenerate hand in OpenXR's format (``frames_of``).

    xyz      (K, 3) joints of the skeleton in mm, camera axes
    camera   that saw it, for landmarks in the image
    cube_mm  of a crop without its frame: landmarks are in the crop then
    frames   the hand's directions, if they are computed already (``hand_frames``)
    """
    if name not in FORMATS:
        raise DataError(f"format {name!r}{did_you_mean(str(name), FORMATS)}; expected {', '.join(FORMATS)}")
    if cube_mm is not None and not 0 < cube_mm < math.inf:
        raise DataError(f"cube_mm {cube_mm}; expected a positive number")
    chosen, xyz = FORMATS[name], joints_of(skeleton, hand, xyz)
    points = _weights(name, skeleton) @ xyz
    scale = np.array(chosen.axes) / (METRE if chosen.unit == "m" else 1.0)
    if name == "mediapipe":
        return FormattedHand(chosen, points * scale, landmarks=_landmarks(points, camera, cube_mm))
    if name != "openxr":
        return FormattedHand(chosen, points * scale)
    mirror = mirror_of(hand)
    frames = frames or hand_frames(skeleton, hand, xyz)
    turns = _orientations(frames, points * mirror) * (mirror * chosen.axes)
    return FormattedHand(chosen, points * scale, _quaternions(turns), _radii(skeleton) * frames.unit_mm / METRE)


@functools.lru_cache(maxsize=16)
def _weights(name: FormatName, skeleton: Skeleton) -> Array:
    return weights_of(list(FORMATS[name].joints.values()), skeleton)


def _landmarks(points: Array, camera: Camera | None, cube_mm: float | None) -> Array | None:
    """MediaPipe's landmarks of points (J, 3), the wrist first; the corner of the image is half a pixel before 0."""
    x, y, z = points.T
    if camera is not None and camera.width:
        if not z.min() > 0:
            raise DataError(f"a joint at depth {z.min():g} mm is not in the image; expected joints before the camera")
        u, v, d = camera.project(points).T
        behind = (d - d[0]) / d[0] * camera.fx
        return np.stack([(u + 0.5) / camera.width, (v + 0.5) / camera.height, behind / camera.width], axis=1)
    if cube_mm is None:
        return None
    return np.stack([0.5 + x / cube_mm, 0.5 - y / cube_mm, (z - z[0]) / cube_mm], axis=1)


# ---------------------------------------------------------------------------------------------- OpenXR


def _orientations(frames: HandFrames, points: Array) -> Array:
    """The directions (J, 2, 3) to the fingertip and out of the back, for OpenXR's joints of a right hand."""
    at = dict(zip(FORMATS["openxr"].joints, points))
    palm, wrist = frames.palm["middle"], at["MIDDLE_METACARPAL"] - at["WRIST"]
    found = {"PALM": (palm, frames.dorsal), "WRIST": (wrist, frames.dorsal)}
    for finger in ("thumb", *FINGERS):
        names = [joint for joint in at if joint.startswith(finger.upper())]
        bones = [unit(at[b] - at[a]) for a, b in itertools.pairwise(names)]
        if finger != "thumb":  # the first bone is a metacarpal
            found[names.pop(0)] = bones.pop(0), frames.dorsal
        back = turned(frames.back[finger], frames.bones[finger][0], bones[0])
        for name, bone, after in zip(names, bones, [*bones[1:], bones[-1]]):
            found[name] = bone, back
            back = turned(back, bone, after)
        found[names[-1]] = bones[-1], back
    return np.array([found[joint] for joint in at])


def _quaternions(directions: Array) -> Array:
    """Quaternions (J, 4) of -Z and +Y (J, 2, 3); the second is made perpendicular to the first."""
    along, z = np.linalg.norm(directions[:, 0], axis=1, keepdims=True), -directions[:, 0]
    x = np.cross(directions[:, 1], z)
    length = np.linalg.norm(x, axis=1, keepdims=True)
    if not (length > MIN_SHARE).all():
        joint = list(FORMATS["openxr"].joints)[int(np.argmin(length))]
        raise DataError(f"the orientation of {joint} is not determined; expected bones along the fingers")
    x, z = x / length, z / along
    found = scipy.spatial.transform.Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2)).as_quat()
    return np.asarray(np.where(found[:, 3:] < 0, -found, found))


@functools.lru_cache(maxsize=8)
def _radii(skeleton: Skeleton) -> Array:
    """Radii (J,) of OpenXR's joints in the skeleton's units: the surface's at the joints, with the points' weights."""
    surface = Surface(skeleton)
    ends, radii = np.concatenate([surface.start, surface.end]), surface.radii.T.ravel()
    of_joints = np.array(
        [radii[ends == j].mean() if (ends == j).any() else np.nan for j in range(len(skeleton.joint_names))]
    )
    of_joints[skeleton.joint_names.index("palm")] = 0.0  # no point uses it
    found = np.asarray(_weights("openxr", skeleton) @ of_joints)
    if not np.isfinite(found).all():
        joint = list(FORMATS["openxr"].joints)[int(np.argmin(np.isfinite(found)))]
        raise DataError(f"the surface of skeleton {skeleton.name!r} has no radius at {joint}")
    return found
