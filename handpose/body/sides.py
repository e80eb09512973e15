"""The side of a hand, "right" or "left", and mirroring.

Skeletons and networks know right hands. A left hand is mirrored along x, and the results are
mirrored back.
"""

from __future__ import annotations

from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Array

Side = Literal["right", "left"]
SoughtSide = Literal["right", "left", "either"]  # "either": determined by the prediction

SIDES: tuple[Side, ...] = ("right", "left")
SOUGHT_SIDES: tuple[SoughtSide, ...] = (*SIDES, "either")
MIRROR = np.array([-1.0, 1.0, 1.0])  # along x

T = TypeVar("T", bound=np.generic)


def mirror_of(side: Side) -> Array:
    """The factors (3,) between the axes of a right hand's space and the camera's, in
    both directions.
    """
    return MIRROR if side == "left" else np.ones(3)


def as_right(images: NDArray[T], side: Side) -> NDArray[T]:
    """Images (..., height, width) of a hand of this side, mirrored to a right hand: a view."""
    return images[..., ::-1] if side == "left" else images
