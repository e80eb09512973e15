"""The result of a prediction: the joints of a hand, the fit to its depth, and how reliable both are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.body.sides import Side
from handpose.frames.cameras import Camera
from netlib.blob import Array


@dataclass(frozen=True)
class HandFit:
    """The fit of the capsule model to the depth.

    inputs           (D,) of the skeleton; of a left hand, those of its mirror image
    whole            (D',) of the whole body, likewise: ``inputs`` and the degrees of freedom of the surface alone
    size             scale relative to the skeleton: bones, offsets and radii
    thickness        additional scale of the radii
    cost             sum of squared deviations of the model from the depth
    uncertainty      of the fit (``handpose.fit.network_errors``)
    rejection_score  mm; how unlike a hand the place is (``handpose.fit.rejection``)
    error_mm         expected error of the joints; NaN if it was not measured for these weights
    confidence       probability that the error is below 30 mm; NaN likewise
    capsules         the surface, in mm from the crop's centre
    """

    inputs: Array
    whole: Array
    size: float
    thickness: float
    cost: float
    uncertainty: float
    rejection_score: float
    error_mm: float
    confidence: float
    capsules: Capsules


@dataclass(frozen=True)
class Prediction:
    """The hand in one crop.

    joints      (K, 3) half-cubes from the crop centre: x right, y up, z away from the camera
    network     (K, 3) the joints predicted by the network alone
    crop        (128, 128) in [-1, 1], the network's input; not mirrored
    cube_mm     edge of the crop's cube
    hand        "right" or "left"; "right" for other bodies
    fit         None without a fit
    camera      of the frame
    center_uvd  (3,) crop centre in px, px, mm
    in_frame    False for a crop without its frame: then camera and centre are assumed
    """

    joints: Array
    network: Array
    crop: NDArray[np.float32]
    cube_mm: float
    hand: Side
    fit: HandFit | None
    camera: Camera
    center_uvd: Array
    in_frame: bool = True

    @property
    def joints_mm(self) -> Array:
        """(K, 3) mm from the crop centre."""
        return np.asarray(self.joints * self.cube_mm / 2)

    @property
    def center_mm(self) -> Array:
        """(3,) crop centre in mm, camera axes."""
        return self.camera.unproject(self.center_uvd)

    @property
    def xyz(self) -> Array:
        """(K, 3) joints in mm, camera axes."""
        return np.asarray(self.center_mm + self.joints_mm)


def percent(confidence: float) -> str:
    """``93%``; ``>99%`` for what would be rounded to 100%, since no estimate is certain."""
    return ">99%" if confidence >= 0.995 else f"{confidence:.0%}"
