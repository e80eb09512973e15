"""The fingers of a hand: their outer joints, and their parts of the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.body.joint_formats.frames import FINGERS as LONG_FINGERS
from handpose.body.model import Surface
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

FINGERS = ("thumb", *LONG_FINGERS)


def has_fingers(skeleton: Skeleton) -> bool:
    """True for a hand: a skeleton with a PIP joint, a DIP joint and a tip of each of the five fingers."""
    return all(joint in skeleton.joint_names for finger in FINGERS for point in _joints(finger) for joint in point)


class Fingers:
    """The joints and the capsules of each finger of a hand with this surface.

    capsules  (5, M) True for those of each finger
    """

    def __init__(self, surface: Surface) -> None:
        names = surface.skeleton.joint_names
        self._weights = np.zeros((3 * len(FINGERS), len(names)))
        for row, point in enumerate(point for finger in FINGERS for point in _joints(finger)):
            for joint in point:
                self._weights[row, names.index(joint)] = 1 / len(point)
        self.capsules: NDArray[np.bool_] = np.array([[part == finger for part in surface.parts] for finger in FINGERS])

    def joints(self, joints: Array) -> Array:
        """The three joints (N, 5, 3, 3) of each finger, of the joints (N, K, 3) of hands."""
        return np.asarray(self._weights @ joints).reshape(len(joints), len(FINGERS), 3, 3)


def _joints(finger: str) -> list[tuple[str, ...]]:
    """The skeleton's joints in the middle of which a finger's PIP joint (up to 3 mm), DIP joint and tip are."""
    pip = ("thumb_pip",) if finger == "thumb" else (f"{finger}_pip_a", f"{finger}_pip_b")
    return [pip, (f"{finger}_dip",), (f"{finger}_tip",)]
