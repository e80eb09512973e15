"""What covers a hand within its crop, by comparing the crop with the surface that is expected there.

Readings in front of the expected surface are another object, or the hand itself, which has moved. A part of the hand
continues into the rest of its surface; another object ends at depth steps. And hands have relief: no half of a hand is
as flat as a sheet of paper, a table's edge or a book.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.crops import BACKGROUND, MIN_CONTACT_PX, STEP_PX
from handpose.frames.segmentation import STEP_MM

NEARER_MM = 15.0  # readings this far in front of the expected surface are not of it
IN_FRONT_MM = 25.0  # mean of these distances in a covering, at least
SIDEWAYS_MM = 30.0  # a covering is followed to this distance from the expected outline
MAX_SMOOTH = 0.2  # share of the border with the rest of the hand without a depth step, at most
# A surface is flat if most of it is this close to a plane (root mean square), found in some rounds. In every fourth
# frame of CVAR's P1, P3, P4, P6, P7 and of hpx, halves of hands have at least 1.1 mm, 99% of discs of 3,900 mm2 0.8 mm.
MIN_FLAT, FLAT_MM, MIN_FLAT_MM2, TRIMMED = 0.6, 0.8, 2000.0, 4
_AROUND = np.ones((3, 3), np.uint8)


class Covering(NamedTuple):
    """What is in front of an expected surface in a crop.

    apart  (S, S) True for the pixels of objects other than the hand
    flat   share of the expected surface's pixels behind objects that are flat
    """

    apart: NDArray[np.bool_]
    flat: float


def covering(
    crop: NDArray[np.float32], surface: NDArray[np.float32], half_mm: float, pixel_mm: float
) -> Covering:  # fmt: skip
    """What covers an expected surface (S, S) in a crop (S, S), both in [-1, 1].

    half_mm   half the edge of the cube
    pixel_mm  width of a pixel of the camera's image, at the crop's depth
    """
    on = surface < BACKGROUND
    reach = 2 * round(SIDEWAYS_MM / 2 * len(crop) / half_mm) + 1
    expected = np.where(on, surface, cv2.erode(surface, np.ones((reach, reach), np.uint8)))
    before = np.where(expected < BACKGROUND, (expected - crop) * half_mm, np.float32(0))
    nearer, at_place = before > NEARER_MM, on & (np.abs(before) < NEARER_MM)
    step = max(STEP_MM, STEP_PX * pixel_mm) / half_mm
    stepped = crop - cv2.erode(crop, _AROUND) > step  # the far side of a depth step
    count, component = cv2.connectedComponents((nearer & ~stepped).astype(np.uint8), connectivity=8)
    border, smooth = np.zeros((2, count), int)
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
        for p, q in ((a, b), (np.s_[:, a], np.s_[:, b])):
            both = (component[p] > 0) & at_place[q]
            joined = both & (np.abs(crop[p] - crop[q]) < step)
            border += np.bincount(component[p][both], minlength=count)
            smooth += np.bincount(component[p][joined], minlength=count)
    hidden = np.bincount(component[on], minlength=count)
    distance = np.bincount(component[on], before[on], count) / np.maximum(hidden, 1)
    flat = np.array([n > 0 and _is_flat(crop, on & (component == n), half_mm) for n in range(count)])
    apart = (distance > IN_FRONT_MM) & (flat | (smooth < np.maximum(MIN_CONTACT_PX, MAX_SMOOTH * border)))
    apart[0] = False
    around = cv2.dilate(apart[component].astype(np.uint8), _AROUND) > 0
    return Covering(apart[component] | (around & nearer & stepped), float(hidden[flat].sum() / max(on.sum(), 1)))


def _is_flat(crop: NDArray[np.float32], which: NDArray[np.bool_], half_mm: float) -> bool:
    """True if some pixels of a crop show a large flat surface."""
    pixel_mm = 2 * half_mm / len(crop)
    row, column = np.nonzero(which)
    if len(row) * pixel_mm**2 < MIN_FLAT_MM2:
        return False
    z, ground = crop[which] * half_mm, np.stack([row * pixel_mm, column * pixel_mm, np.ones(len(row))], axis=1)
    distance, nearest = np.zeros(len(row)), np.ones(len(row), bool)
    for _ in range(TRIMMED):
        distance = np.abs(z - ground @ np.linalg.lstsq(ground[nearest], z[nearest], rcond=None)[0])
        nearest = distance <= np.quantile(distance, MIN_FLAT)
    return bool(np.sqrt(np.mean(distance[nearest] ** 2)) < FLAT_MM)
