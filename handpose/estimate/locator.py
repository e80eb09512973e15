"""Where hands are in a depth image.

The locator is a small network. It evaluates places all over the visible surface: the probability of a hand near each,
and the position of its middle. The most likely places are evaluated again at these positions; of places close together
the most likely is kept. It does not distinguish left from right.

Without it, ``find_hand`` gives the centre of mass of the nearest object. Both are starts: ``recenter`` then moves the
crop to the palm that the network predicts, as in the training crops (joint 34 of the NYU annotation).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import CENTER_IN_PALM
from handpose.body.sides import Side, mirror_of
from handpose.fit.rounding import PLACE_STEP_MM, rounded
from handpose.frames.cameras import Camera
from handpose.frames.images import depth_image
from handpose.frames.places import CUBE_MM, FAR_MM, MIN_DEPTH_MM, SIZE, place_crops, surface_places
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.net import Net

MAX_RECHECKED = 12  # number of places that are evaluated again
TIMES = 3  # number of further evaluations, each at the predicted position
APART_MM = 60.0  # hands closer than this are one
HANDS = 4  # maximum number of hands returned, in addition to the nearest object
TOGETHER = 64  # crops in one pass of the network
# Hands are held towards the camera: the odds of a place fall by a factor e with every 100 mm of depth.
FARTHER_MM = 100.0
SURE = 1e-5  # probabilities are clipped to [SURE, 1 - SURE]

# Tuned on whole images of rendered hands: half of the centres are within 31 mm of the true one, nine of ten within
# 55 mm.
FRONT_MM2 = 1500.0  # minimum visible area of the nearest object; less is noise
SLAB_MM = 160.0  # depth range behind the front that contains the hand
REACH_MM = 125.0  # radius about the centre of mass: the hand, and little of the forearm
PALM_MM = 15.0  # from the surface of the palm to its middle
BEHIND_MM = 38.0  # from the mean of the visible points, which are in front, to the centre
MAX_PIXELS = 1 << 21  # larger images are subsampled


class Located(NamedTuple):
    """Places of hands, the most likely first; the last is the nearest object, unless it is one of the others."""

    center: Array  # (C, 3) mm, camera axes: centres of crops about them
    odds: Array  # (C,) log-odds of a hand: the net's, less 1 for each FARTHER_MM of depth


class Locator:
    """A net with the input depth (N, 1, 64, 64) and the outputs chance (N, 2) and where (N, 3). Raises NetlibError."""

    def __init__(self, net: Net) -> None:
        for name, shape in (("depth", (1, SIZE, SIZE)), ("chance", (2,)), ("where", (3,))):
            found = net.blobs[name].shape[1:] if name in net.blobs else None
            if found != shape:
                raise NetlibError(
                    f"{net.source}: blob {name!r} of shape {found} an item, expected {shape} of a locator"
                )
        self.net = net

    def hands(self, depth: NDArray[np.generic], camera: Camera) -> Located:
        """Find hands in a depth image (height, width) in mm, 0 where there is no reading.

        Raises DataError if nothing visible can be a hand, and for an image of another size than the camera's.
        """
        image = depth_image(depth)
        if not (image > 0).any():
            raise DataError("no depth anywhere in the image")
        crops, centers = place_crops(image, surface_places(image, camera), camera)
        if not len(centers):
            raise DataError(f"nothing as large as a hand is seen nearer than {FAR_MM:.0f} mm")
        chance, where = self.look(crops)
        for _ in range(TIMES):
            best = np.argsort(-odds_of(chance, centers), kind="stable")[:MAX_RECHECKED]
            crops, centers = place_crops(image, (centers + where)[best], camera)
            if not len(centers):
                raise DataError("what may be a hand is out of sight")
            chance, where = self.look(crops)
        odds, centers = odds_of(chance, centers), centers + where
        shown = _in_sight(centers, camera)
        if not shown.any():
            raise DataError("what may be a hand is out of sight")
        found = _apart(odds[shown], centers[shown], HANDS)
        try:
            nearest = camera.unproject(find_hand(image, camera))[None]
        except DataError:  # too small for a hand
            return found
        crops, nearest = place_crops(image, nearest, camera)
        if len(nearest) and np.linalg.norm(found.center - nearest, axis=1).min() > APART_MM:
            odds = odds_of(self.look(crops)[0], nearest)
            found = Located(np.concatenate([found.center, nearest]), np.concatenate([found.odds, odds]))
        return found

    def at(self, depth: NDArray[np.generic], places: Array, camera: Camera) -> tuple[Array, Array]:
        """Probabilities (n,) of hands near the places (N, 3) in the image, and their middles (n, 3) in mm.

        Raises NetlibError for outputs that are not finite.
        """
        crops, kept = place_crops(depth, places, camera)
        chance, where = self.look(crops)
        return chance, kept + where

    def look(self, crops: NDArray[np.floating]) -> tuple[Array, Array]:
        """Probability (N,) of a hand near the middle of crops (N, SIZE, SIZE), and its offset (N, 3) in mm.

        Raises NetlibError for outputs that are not finite.
        """
        chance, where = [np.zeros(0)], [np.zeros((0, 3))]
        for first in range(0, len(crops), TOGETHER):
            some = np.ascontiguousarray(crops[first : first + TOGETHER, None], np.float32)
            found = self.net.forward(blobs=["where"], depth=some)
            chance.append(found["chance"][:, 1].astype(np.float64))
            where.append(rounded(found["where"] * (CUBE_MM / 2), PLACE_STEP_MM))
        if not all(np.isfinite(values).all() for values in (*chance, *where)):
            raise NetlibError(f"{self.net.source}: answers that are not finite; check its weights")
        return np.concatenate(chance), np.concatenate(where)


def odds_of(chance: Array, center: Array) -> Array:
    """The log-odds (N,) of places (N, 3) with these probabilities (N,)."""
    sure = np.clip(chance, SURE, 1 - SURE)
    return np.asarray(np.log(sure / (1 - sure)) - center[:, 2] / FARTHER_MM)


def _in_sight(center: Array, camera: Camera) -> NDArray[np.bool_]:
    """True (N,) for places (N, 3) in the image."""
    before = center[:, 2] > MIN_DEPTH_MM
    u, v, _ = camera.project(np.where(before[:, None], center, (0, 0, MIN_DEPTH_MM))).T
    return np.asarray(before & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height))


def _apart(odds: Array, center: Array, count: int) -> Located:
    """The most likely of places (N, 3) that are not close to a more likely one."""
    kept: list[int] = []
    for i in np.argsort(-odds, kind="stable"):
        if all(np.linalg.norm(center[i] - center[j]) > APART_MM for j in kept):
            kept.append(int(i))
    return Located(center[kept[:count]], odds[kept[:count]])


def find_hand(depth: NDArray[np.generic], camera: Camera) -> Array:
    """Centre (3,), u, v in px and d in mm, of the nearest object in a depth image (height, width) in mm.

    Raises DataError if there is no surface as large as a hand.
    """
    whole = depth_image(depth)
    step = max(1, math.ceil(math.sqrt(whole.size / MAX_PIXELS)))
    image = np.asarray(whole[step // 2 :: step, step // 2 :: step])
    seen = np.isfinite(image) & (image > 0)
    if not seen.any():
        raise DataError("no depth anywhere in the image")
    depths = np.sort(image[seen]).astype(np.float64)  # integers are sorted faster
    image = np.asarray(image, dtype=np.float64)
    surface = step**2 * np.cumsum(depths**2) / (camera.fx * camera.fy)  # visible area in mm² up to each depth
    if surface[-1] < FRONT_MM2:
        raise DataError(f"only {surface[-1]:.0f} mm² of surface in the image, expected a hand")
    front = depths[np.searchsorted(surface, FRONT_MM2)]
    slab = seen & (image <= front + SLAB_MM)
    _, label, _, _ = cv2.connectedComponentsWithStats(slab.astype(np.uint8), connectivity=8)
    nearest = seen & (image <= front)
    shown = np.bincount(label[nearest], weights=image[nearest] ** 2)  # area, because near specks have many pixels
    one = label == 1 + np.argmax(shown[1:])
    v, u = (step // 2 + step * pixels for pixels in np.nonzero(one))
    points = np.ascontiguousarray(camera.unproject(np.stack([u, v, image[one]], axis=1)).T)
    near = nearest[one]
    for _ in range(11):
        center = (points * near).sum(axis=1) / near.sum()
        off = points - center[:, None]
        before, near = near, (off * off).sum(axis=0) < REACH_MM**2
        if not near.any() or np.array_equal(near, before):
            break
    return camera.project(center + (0, 0, BEHIND_MM))


def depth_around(depth: NDArray[np.generic], u: float, v: float, reach: int = 8) -> Array:
    """Centre (3,) at pixel u, v with the median depth around it: u, v in px and d in mm. Raises DataError."""
    image = depth_image(depth)
    row, column = round(v), round(u)
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
        raise DataError(f"pixel {u:g}, {v:g} lies outside the image of {image.shape[1]} x {image.shape[0]}")
    around = image[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    seen = around[np.isfinite(around) & (around > 0)]
    if not len(seen):
        raise DataError(f"no depth around pixel {u:g}, {v:g}")
    return np.array([u, v, np.median(seen) + PALM_MM])


def recenter(
    joints: ArrayLike, skeleton: Skeleton, center_uvd: ArrayLike, cube_mm: float, camera: Camera, side: Side = "right"
) -> Array:
    """The crop centre (3,) for joints predicted in the crop at ``center_uvd``, as in the training crops.

    joints  (K, 3) half-cubes from the crop centre; those of a left hand mirrored
    side    of the hand

    For nets trained with NYU's centres; those of other data sets are elsewhere in the palm (ICVL's at its joint).
    Raises DataError if the skeleton has no palm.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(f"skeleton {skeleton.name!r} has no joint 'palm' to move the crop to")
    mirror = mirror_of(side)
    hand = np.asarray(joints, dtype=np.float64).reshape(-1, 3)
    palm = hand[skeleton.joint_names.index("palm")]
    move = rounded(palm * cube_mm / 2 + palm_frame(hand, skeleton) @ CENTER_IN_PALM, PLACE_STEP_MM)
    return camera.project(camera.unproject(np.asarray(center_uvd, dtype=np.float64)) + move * mirror)
