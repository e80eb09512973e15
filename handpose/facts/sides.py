"""The side of a hand, "right" or "left", and what follows from it.

Skeletons and networks know right hands. A left hand is seen in a mirror along x, as a right one, and what is found of
it there is mirrored back.
"""

from __future__ import annotations

from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.facts.cameras import Array

Side = Literal["right", "left"]
SoughtSide = Literal["right", "left", "either"]  # "either" is for who finds a hand to tell

SIDES: tuple[Side, ...] = ("right", "left")
SOUGHT_SIDES: tuple[SoughtSide, ...] = (*SIDES, "either")
MIRROR = np.array([-1.0, 1.0, 1.0])  # along x

T = TypeVar("T", bound=np.generic)


def side_of(word: str) -> Side:
    """The side that a word from outside names. Raises ValueError."""
    for side in SIDES:
        if word == side:
            return side
    raise ValueError(f"{word!r}, expected 'right' or 'left'")


def other_side(side: Side) -> Side:
    """Left of right, right of left."""
    return "left" if side == "right" else "right"


def is_mirrored(side: Side) -> bool:
    """Is a hand of this side the mirror image of the skeleton's?"""
    return side == "left"


def mirror_of(side: Side) -> Array:
    """What (3,) turns places of a hand's own space, where it is a right one, to those of the camera, and back."""
    return MIRROR if is_mirrored(side) else np.ones(3)


def as_right(images: NDArray[T], side: Side) -> NDArray[T]:
    """Images (..., height, width) of a hand of this side, as of a right one: a view."""
    return images[..., ::-1] if is_mirrored(side) else images
