"""The locator: a small network that finds hands in a depth image.

It evaluates places all over the visible surface: the probability of a hand near each, and the position of its middle.
The most likely places are evaluated again at these positions; of places close together the most likely is kept. It does
not distinguish left from right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.data.depth_images import depth_image
from handpose.data.places import CUBE_MM, FAR_MM, MIN_DEPTH_MM, SIZE, place_crops, surface_places
from handpose.facts.cameras import Camera
from handpose.prediction.finding import find_hand
from handpose.rounding import PLACE_STEP_MM, rounded
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
