"""The side of a hand, "right" or "left", and the frame as a hand of that side sees it.

Skeletons and networks know right hands. So a frame with a left hand is mirrored once, by
``SideView``, and what was found in it once, at the end (``mirror_of``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Array, Camera, Floats

Side = Literal["right", "left"]
SoughtSide = Literal["right", "left", "either"]  # "either": determined by the prediction

SIDES: tuple[Side, ...] = ("right", "left")
SOUGHT_SIDES: tuple[SoughtSide, ...] = (*SIDES, "either")
MIRROR = np.array([-1.0, 1.0, 1.0])  # along x

T = TypeVar("T", bound=np.generic)


def mirror_of(side: Side) -> Array:
    """The factors (3,) between the axes of a side's view and the camera's, in both directions."""
    return MIRROR if side == "left" else np.ones(3)


def as_right(images: NDArray[T], side: Side) -> NDArray[T]:
    """Images (..., height, width) as a hand of this side sees them, or back: a view of them."""
    return images[..., ::-1] if side == "left" else images


def camera_of(camera: Camera, side: Side) -> Camera:
    """The camera of a side's view of the frames, or back."""
    return camera.mirrored() if side == "left" else camera


def pixel_of(uvd: Array, camera: Camera, side: Side) -> Array:
    """A pixel and its depth (3,) in a side's view of the frames, or back."""
    u, v, d = uvd
    return np.array([camera.width - 1 - u, v, d]) if side == "left" else uvd


@dataclass(frozen=True)
class SideView:
    """A depth frame in which a hand of one side is a right hand: for a left hand its mirror image.

    The view of the right side is the frame itself.

    camera    of these images
    depth     (height, width) mm, what the camera can measure; 0 where there is no reading
    readings  (height, width) mm, with those that are nearer than the camera measures
    weight    (height, width) of the pixels in a fit, 0 to 1; None: all are alike
    """

    side: Side
    camera: Camera
    depth: NDArray[np.generic]
    readings: NDArray[np.generic]
    weight: Floats | None = None

    def of(self, side: Side) -> SideView:
        """The view of a side, of the same frame."""
        if side == self.side:
            return self
        camera = self.camera.mirrored()
        weight = None if self.weight is None else self.weight[:, ::-1]
        return SideView(side, camera, self.depth[:, ::-1], self.readings[:, ::-1], weight)

    def weighted(self, weight: Floats | None) -> SideView:
        """The view with weights (height, width) of the camera's pixels, or None."""
        own = None if weight is None else as_right(weight, self.side)
        return replace(self, weight=own)

    def pixel_in(self, side: Side, uvd: Array) -> Array:
        """A pixel of this view and its depth (3,) in the view of a side."""
        return uvd if side == self.side else pixel_of(uvd, self.camera, "left")
