"""Anatomical points of a hand as weighted means of the skeleton's joints.

The skeleton has NYU's annotation points: two for every phalanx of a finger, near its ends. A finger has six of them:

    mcp .... base .. pip_a .... pip_b .. dip .... tip
    |- proximal -|   |- middle -|   |- distal -|

The PIP joint is therefore between ``base`` and ``pip_a``, the DIP joint between ``pip_b`` and ``dip``. Weights were
chosen from the proportions of adult phalanges; labels of a real camera, which have these joints, agree
(docs/joint_formats.md). The weights of a point sum to 1, so points move, turn, scale and mirror with the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from netlib.blob import Array
from netlib.errors import DataError

NO_HAND = "the skeleton has no joint {!r}; only hands have joints and angles of other formats"
FINGERS = ("index", "middle", "ring", "little")
PALM_BONES = {"index": 0.75, "middle": 0.58, "ring": 0.42, "little": 0.25}  # share of wrist_middle; wrist_left the rest
CARPALS = 0.3  # position between wrist (0) and knuckle (1)
SKIN = {"thumb": 0.39, "index": 0.62, "middle": 0.48, "ring": 0.52, "little": 0.64}  # last radius / last bone


class Point(NamedTuple):
    """A point of the hand.

    weights  of the skeleton's joints, by name
    bias     position relative to the anatomical point: distal is towards the fingertip, dorsal towards the back of the
             hand, palmar away from it
    """

    weights: dict[str, float]
    bias: str


def _points() -> dict[str, Point]:
    found = {
        "wrist": Point({"wrist_left": 0.5, "wrist_middle": 0.5}, "9 mm dorsal of the middle of the wrist"),
        "thumb_cmc": Point({"thumb_mcp": 1}, "by the bones' proportions up to 15 mm distal; 8 mm dorsal"),
        "thumb_mcp": Point({"thumb_pip": 0.85, "thumb_dip": 0.15}, "2 mm dorsal; the model's hinge is 7 mm proximal"),
        "thumb_ip": Point({"thumb_dip": 1}, "4 mm distal, 4 mm palmar"),
        "thumb_tip": Point({"thumb_tip": 1}, "2 mm distal, 2 mm palmar; 9 mm before the end of the thumb"),
        "thumb_skin": Point(_beyond("thumb"), "the end of the thumb in the surface model"),
    }
    for finger in FINGERS:
        radial, base = PALM_BONES[finger], 1 - CARPALS
        cmc = {"wrist_middle": base * radial, "wrist_left": base * (1 - radial), f"{finger}_mcp": CARPALS}
        pip = {f"{finger}_base": 0.3, f"{finger}_pip_a": 0.7}
        dip = {f"{finger}_pip_b": 0.6, f"{finger}_dip": 0.4}
        found |= {
            f"{finger}_cmc": Point(cmc, "a fixed proportion of the palm, not observable; 8 mm dorsal"),
            f"{finger}_mcp": Point({f"{finger}_mcp": 1}, "2 mm distal, 2 mm dorsal"),
            f"{finger}_pip": Point(pip, "2 mm proximal, 2 mm dorsal; the model's hinge, base, is 7 to 19 mm proximal"),
            f"{finger}_dip": Point(dip, "2 mm proximal, 2 mm dorsal; the model's hinge, pip_b, is 7 to 9 mm proximal"),
            f"{finger}_tip": Point({f"{finger}_tip": 1}, "4 mm distal; 9 mm before the end of the finger"),
            f"{finger}_skin": Point(_beyond(finger), "the end of the finger in the surface model"),
        }
    middle = found["middle_cmc"].weights
    palm = {joint: weight / 2 for joint, weight in middle.items()} | {"middle_mcp": (1 + CARPALS) / 2}
    found["palm_middle"] = Point(palm, "7 mm dorsal of the middle of the palm")
    return found


def _beyond(finger: str) -> dict[str, float]:
    """The end of a fingertip, its radius beyond the last joint."""
    return {f"{finger}_tip": 1 + SKIN[finger], f"{finger}_dip": -SKIN[finger]}


POINTS = _points()


def weights_of(points: Sequence[Point], joint_names: Sequence[str]) -> Array:
    """Weights (P, K) that turn the joints of a skeleton into points. Raises DataError for another body than a hand."""
    index = {name: i for i, name in enumerate(joint_names)}
    weights = np.zeros((len(points), len(index)))
    for row, point in enumerate(points):
        for joint, weight in point.weights.items():
            if joint not in index:
                raise DataError(NO_HAND.format(joint))
            weights[row, index[joint]] = weight
    return weights
