"""Places where a hand may be, and crops of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side, as_right, pixel_of
from handpose.fit.body import WorldPose
from handpose.frames.cameras import Camera
from netlib.blob import Array


@dataclass(frozen=True)
class SearchRegion:
    """A place where a hand may be.

    center_uvd  (3,) px, px, mm: centre of its crop, in the view of the side
    side        assumed side of the hand
    before      the body expected from earlier frames, or None
    size        of the hand, if known
    asks_network  False: the fit starts from ``before`` alone
    """

    center_uvd: Array
    side: Side
    before: WorldPose | None = None
    size: float | None = None
    asks_network: bool = True


@dataclass(frozen=True, kw_only=True)
class Candidate(SearchRegion):
    """A region and its crop.

    crop        (128, 128) in [-1, 1]
    shown       (128, 128) the crop for the network, if it is another one
    weight      (128, 128) of the pixels in a fit; None: all are alike
    """

    crop: NDArray[np.float32]
    shown: NDArray[np.float32] | None = None
    weight: NDArray[np.float32] | None = None

    @classmethod
    def of_side(
        cls, side: Side, crop: NDArray[np.float32], center_uvd: Array, camera: Camera
    ) -> Candidate:
        """A crop of a camera's frame, taken as a hand of this side."""
        return cls(pixel_of(center_uvd, camera, side), side, crop=as_right(crop, side))
