"""Where hands are in a depth image: a small network looks at places all over the surface that was seen.

It says of each how likely a hand is near, and where that hand's middle is. The likely ones are looked at again from
there, and of what comes together in one place the likeliest is kept. It does not know left from right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.data.places import CUBE_MM, SIZE, place_crops, surface_places
from handpose.facts.cameras import Camera
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.net import Net

AGAIN = 12  # of the places, the likeliest are looked at again ...
TIMES = 3  # ... so often, each time from where the hand was said to be
APART_MM = 60.0  # hands nearer to each other are one
HANDS = 4  # at most so many are told
TOGETHER = 64  # crops that are looked at together


class Located(NamedTuple):
    """Where hands may be, the likeliest first."""

    center: Array  # (C, 3) mm, camera axes: the middles of crops about them
    chance: Array  # (C,) that there is a hand


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

    def hands(self, depth: ArrayLike, camera: Camera) -> Located:
        """Where hands may be in a depth image (height, width) in mm, 0 where nothing was read.

        Raises DataError if nothing is seen that is near enough.
        """
        image = np.asarray(depth)
        crops, centers = place_crops(image, surface_places(image, camera), camera)
        if not len(centers):
            raise DataError("nothing is seen within 1.6 m, expected a hand")
        chance, where = self.look(crops)
        for _ in range(TIMES):
            likeliest = np.argsort(-chance, kind="stable")[:AGAIN]
            crops, centers = place_crops(image, (centers + where)[likeliest], camera)
            if not len(centers):
                raise DataError("what may be a hand is out of sight")
            chance, where = self.look(crops)
        centers = centers + where
        kept: list[int] = []
        for i in np.argsort(-chance, kind="stable"):
            if all(np.linalg.norm(centers[i] - centers[j]) > APART_MM for j in kept):
                kept.append(int(i))
        return Located(centers[kept[:HANDS]], chance[kept[:HANDS]])

    def look(self, crops: NDArray[np.floating]) -> tuple[Array, Array]:
        """Chance (N,) that a hand is near in crops (N, SIZE, SIZE), and how far (N, 3) in mm its middle is off."""
        chance, where = [], []
        for first in range(0, len(crops), TOGETHER):
            some = np.ascontiguousarray(crops[first : first + TOGETHER, None], np.float32)
            found = self.net.forward(blobs=["where"], depth=some)
            chance.append(found["chance"][:, 1].astype(np.float64))
            where.append(found["where"].astype(np.float64) * (CUBE_MM / 2))
        if not all(np.isfinite(values).all() for values in (*chance, *where)):
            raise NetlibError(f"{self.net.source}: answers that are not finite; check its weights")
        return np.concatenate(chance), np.concatenate(where)
