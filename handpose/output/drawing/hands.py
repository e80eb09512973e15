"""Pictures of hands and other bodies: skeletons on depth crops, and in space.

All pictures are (height, width, 3) uint8 arrays in OpenCV's colour order, ready for
``cv2.imwrite``. Joints are (K, 3) in half-cubes from the crop centre: x right, y up, z away
from the camera.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.model import FINGERS
from handpose.body.nyu import CUBE_MM
from handpose.frames.cameras import NYU, Camera
from handpose.frames.crops import crop_pixels, restore_joints
from handpose.output.drawing import sheets, strokes
from handpose.output.drawing.strokes import Colour, Image
from layers.hand.kinematics import rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

# Blue, green, red, of fingers and of the limbs of other bodies; everything else is grey.
FINGER_COLOURS: dict[str, Colour] = {
    "thumb": (80, 90, 240),
    "index": (40, 165, 250),
    "middle": (90, 200, 90),
    "ring": (225, 185, 60),
    "little": (225, 95, 170),
}
GREY: Colour = (200, 200, 200)
WHITE: Colour = (255, 255, 255)
BLACK: Colour = (0, 0, 0)
_PAPER: Colour = (248, 248, 248)
_LINE: Colour = (222, 222, 222)
_AXIS: Colour = (110, 110, 110)
_SHADOW: Colour = (212, 212, 212)
_INK: Colour = (60, 60, 60)
FLOOR, FLOOR_LINES, AXIS_LENGTH = -1.0, 7, 0.4  # in half-cubes
GUESS_MM = 30.0  # a finger with a larger expected error is drawn as a guess
_NEAREST_GREY = 215  # of the front of the cube
YAW, PITCH = 35.0, 20.0  # degrees: where the view in space is seen from
VIEWER = 7.0  # distance from the middle of the cube in half-cubes: a weak perspective
# in that picture: its middle, and the length of a half-cube
CUBE_PLACE, CUBE_SHARE = (0.5, 0.46), 0.33
PAGE_COLUMNS = 6  # of a page of ``two_views``
LEGEND = "in colour: predicted; thin white, in space thin black: annotated"


def overlay(
    crop: NDArray[np.floating],
    joints: ArrayLike,
    skeleton: Skeleton,
    truth: ArrayLike | None = None,
    center_uvd: ArrayLike | None = None,
    cube_mm: float = CUBE_MM,
    camera: Camera = NYU,
    zoom: int = 4,
    guesses: Collection[str] = (),
) -> Image:
    """The skeleton on the crop (S, S) in [-1, 1], enlarged ``zoom`` times.

    Raises DataError for a crop that is no square, and for joints of another skeleton.

    truth       joints in thin white
    center_uvd  (3,) px, px, mm of the crop, with which joints are drawn exactly at their pixels.
                Without it the projection is parallel, which shifts joints at the near or far face
                of the cube by up to a tenth of the image
    cube_mm, camera  of the crop, for its centre
    guesses     fingers that are drawn hollow (``draw``)
    """
    depth = np.squeeze(np.asarray(crop))
    if depth.ndim != 2 or depth.shape[0] != depth.shape[1]:
        raise DataError(f"crop of shape {np.shape(crop)}, expected a square of depths")
    size = len(depth)
    canvas = picture(depth, zoom)

    def place(points: Array) -> Array:
        if center_uvd is None:
            at = size / 2 * (1 + points[:, :2] * (1, -1))
        else:
            center = np.asarray(center_uvd, dtype=np.float64).reshape(1, 3)
            xyz = restore_joints(points[None], camera.unproject(center), cube_mm / 2)
            at = crop_pixels(camera.project(xyz), center, cube_mm, camera, size)[0]
        return (at + 0.5) * zoom - 0.5

    points = _checked(joints, skeleton)
    draw(canvas, place(points), points[:, 2], skeleton, thick=max(zoom // 2, 1), guesses=guesses)
    if truth is not None:
        points = _checked(truth, skeleton)
        draw(canvas, place(points), points[:, 2], skeleton, thick=1, colour=WHITE)
    return canvas


def picture(crop: NDArray[np.floating], zoom: int = 1) -> Image:
    """A crop (S, S) in [-1, 1] alone, enlarged ``zoom`` times: nearer is lighter, the
    background black.
    """
    nearness = (1 - np.clip(crop, -1, 1)) * 0.5
    grey = np.rint(nearness * _NEAREST_GREY).astype(np.uint8)
    return np.asarray(cv2.cvtColor(enlarged(grey, zoom), cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def enlarged(image: NDArray[Any], zoom: int, how: int = cv2.INTER_NEAREST) -> NDArray[Any]:
    """An image enlarged ``zoom`` times, by OpenCV's interpolation ``how``."""
    return cv2.resize(image, None, fx=zoom, fy=zoom, interpolation=how)


def view_3d(
    joints: ArrayLike,
    skeleton: Skeleton,
    truth: ArrayLike | None = None,
    size: int = 512,
    guesses: Collection[str] = (),
) -> Image:
    """The skeleton in the cube around the body, seen from YAW degrees to the right of the
    camera and PITCH up, with its shadow on the floor of the cube.

    Raises DataError for joints of another skeleton.

    truth    joints in thin black
    size     px of both sides
    guesses  fingers that are drawn hollow (``draw``)
    """
    view = rotation(0, -np.deg2rad(PITCH)) @ rotation(1, np.deg2rad(YAW))
    middle = size * np.array(CUBE_PLACE)

    def place(points: Array) -> tuple[Array, Array]:
        """The pixels (K, 2) of points, and their depths (K,) in the view."""
        seen = points @ view.T
        scale = size * CUBE_SHARE * VIEWER / (VIEWER + seen[:, 2:])
        pixels = seen[:, :2] * scale * (1, -1) + middle
        return pixels, seen[:, 2]

    canvas = np.full((size, size, 3), _PAPER, dtype=np.uint8)
    _draw_floor(canvas, place)
    points = _checked(joints, skeleton)
    shadow = points * (1, 0, 1) + (0, FLOOR, 0)
    draw(canvas, place(shadow)[0], points[:, 1], skeleton, thick=2, colour=_SHADOW)
    draw(canvas, *place(points), skeleton, thick=max(size // 200, 1), guesses=guesses)
    if truth is not None:
        draw(canvas, *place(_checked(truth, skeleton)), skeleton, thick=1, colour=_INK)
    return canvas


def _draw_floor(canvas: Image, place: Callable[[Array], tuple[Array, Array]]) -> None:
    """Draw the lines of the cube's floor, and the axes along its edges.

    place  the pixels of points, and their depths
    """
    for line in np.linspace(-1, 1, FLOOR_LINES):
        for ends in ([(line, FLOOR, -1), (line, FLOOR, 1)], [(-1, FLOOR, line), (1, FLOOR, line)]):
            start, stop = place(np.array(ends, dtype=np.float64))[0]
            strokes.line(canvas, start, stop, _LINE, 1)
    for label, direction in zip("xyz", np.eye(3)):
        corner = np.array([-1, FLOOR, -1])
        start, stop = place(np.stack([corner, corner + AXIS_LENGTH * direction]))[0]
        strokes.line(canvas, start, stop, _AXIS, 2)
        outwards = (stop - start) / np.linalg.norm(stop - start)
        strokes.text(canvas, label, stop + outwards * 9 + (-4, 4), _AXIS, 0.45)


def two_views(
    crops: Sequence[NDArray[np.floating]],
    joints: Array,
    truth: Array,
    skeleton: Skeleton,
    titles: Sequence[tuple[str, str]],
    centers: Array | None,
    camera: Camera,
    cube_mm: Sequence[float],
) -> Image:
    """Every body on its crop and in space: the predicted one in colour, the annotated one in thin
    white and black.

    joints  (n, K, 3) half-cubes, all joints of the skeleton
    truth   (n, L, 3) annotated joints; drawn only if L is K
    titles  of the two views of each frame; a legend stands above all
    centers, camera, cube_mm  of the crops, (n, 3) px, px, mm; without centres the
                              projection is parallel
    """
    images = []
    for n, crop in enumerate(crops):
        annotated = truth[n] if len(truth[n]) == len(joints[n]) else None
        center = None if centers is None else centers[n]
        images.append(
            overlay(crop, joints[n], skeleton, annotated, center, cube_mm[n], camera, zoom=3)
        )
        images.append(view_3d(joints[n], skeleton, annotated, size=384))
    page = sheets.sheet(images, PAGE_COLUMNS, [title for pair in titles for title in pair])
    legend = np.full((24, page.shape[1], 3), 255, dtype=np.uint8)
    strokes.text_within(legend, LEGEND, np.array([8, 18]), (40, 40, 40), 0.5, page.shape[1] - 16)
    return np.concatenate([legend, page])


# ------------------------------------------------------------------------------------ the skeleton


def draw(
    canvas: Image,
    pixels: Array,
    depths: Array,
    skeleton: Skeleton,
    thick: int,
    colour: Colour | None = None,
    guesses: Collection[str] = (),
) -> None:
    """Draw bones and joints at pixels (K, 2), x and y, the farthest first, each with a dark rim.

    depths   (K,) of which only the order counts, the farthest largest
    thick    px, of bones
    colour   of all, then without rims; by default of each joint
    guesses  names of fingers that are drawn hollow: white, with a rim in their colour
    """
    inks = [colour or own for own in colours(skeleton)]
    rims = [BLACK] * len(inks)
    for joint, name in enumerate(skeleton.joint_names):
        if _finger_of(name) in guesses:
            rims[joint], inks[joint] = inks[joint], WHITE
    has_rims = colour is None
    behind_first = sorted(bones(skeleton), key=lambda bone: -(depths[bone[0]] + depths[bone[1]]))
    if has_rims:
        for parent, joint in behind_first:
            strokes.line(canvas, pixels[parent], pixels[joint], rims[joint], thick + 2)
    for parent, joint in behind_first:
        strokes.line(canvas, pixels[parent], pixels[joint], inks[joint], thick)
    for joint in np.argsort(-depths, kind="stable"):
        if has_rims:
            strokes.dot(canvas, pixels[joint], thick + 2, rims[joint])
        strokes.dot(canvas, pixels[joint], thick + has_rims, inks[joint])


def colours(skeleton: Skeleton) -> list[Colour]:
    """The colour of each joint, which is that of its finger; grey outside the fingers.

    In a body without fingers the limbs have different colours; a limb is a chain of joints
    without a fork.
    """
    fingers = [FINGER_COLOURS.get(_finger_of(name)) for name in skeleton.joint_names]
    if any(fingers):
        return [own or GREY for own in fingers]
    palette = list(FINGER_COLOURS.values())
    found = [GREY] * len(fingers)
    for number, limb in enumerate(limbs(skeleton)):
        for joint in limb:
            found[joint] = palette[number % len(palette)]
    return found


def limbs(skeleton: Skeleton) -> list[list[int]]:
    """The joints of each limb, from its end up to where the body forks or begins, in the order
    of the joints.
    """
    children = np.bincount(skeleton.parents[skeleton.parents >= 0], minlength=len(skeleton.parents))
    found = []
    for end in np.flatnonzero(children == 0).tolist():
        limb = [end]
        while (above := int(skeleton.parents[limb[-1]])) >= 0 and children[above] == 1:
            limb.append(above)
        found.append(limb)
    return found


def bones(skeleton: Skeleton) -> list[tuple[int, int]]:
    """The pairs of connected joints: parent, joint."""
    return [(int(parent), joint) for joint, parent in enumerate(skeleton.parents) if parent >= 0]


def _finger_of(joint: str) -> str:
    """The finger of a joint, the part of its name before the first "_"; of a joint of another part
    no name of a finger.
    """
    return joint.partition("_")[0]


def guessed(finger_error_mm: Array) -> list[str]:
    """The fingers whose expected errors (5,) in mm, from the thumb on, are above GUESS_MM."""
    return [
        finger for finger, error in zip(FINGERS, finger_error_mm, strict=True) if error > GUESS_MM
    ]


def _checked(joints: ArrayLike, skeleton: Skeleton) -> Array:
    """Joints as (K, 3). Raises DataError for another number of them, and if one is not finite."""
    points = np.asarray(joints, dtype=np.float64)
    expected = len(skeleton.joint_names)
    if points.size != expected * 3 or not np.isfinite(points).all():
        raise DataError(f"joints of shape {points.shape}, expected ({expected}, 3) finite numbers")
    return points.reshape(expected, 3)
