"""What is told of a hand in a picture: where its joints are, how it is fitted, how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.facts.cameras import Camera
from handpose.facts.sides import Side
from handpose.surface.render import Capsules
from netlib.blob import Array


@dataclass(frozen=True)
class FittedHand:
    """What the fit to the depth found beside the joints.

    inputs      (D,) of the skeleton; of a left hand, those of its mirror image
    whole       (D',) of the whole body, likewise: the same, and what only its flesh has
    size        relative to the skeleton: bones, offsets, radii
    girth       how much thicker still: radii
    misfit      how badly the flesh explains the picture, in deviations squared
    doubt       how much speaks against the fit (``handpose.depth_fit.network_errors``)
    strangeness how little the place is a hand, in mm (``handpose.depth_fit.strangeness``)
    error_mm    the error of the joints to be expected; NaN if nobody has measured it for these weights
    confidence  the chance that it is below 30 mm; NaN likewise
    capsules    the flesh, in mm from the crop's centre
    """

    inputs: Array
    whole: Array
    size: float
    girth: float
    misfit: float
    doubt: float
    strangeness: float
    error_mm: float
    confidence: float
    capsules: Capsules


@dataclass(frozen=True)
class Prediction:
    """The hand in one crop.

    joints   (K, 3) half-cubes from the crop centre: x right, y up, z away from the camera
    network  (K, 3) the same as the network alone has it
    crop     (128, 128) in [-1, 1], where the hand was seen
    cube_mm  edge of the crop's cube
    hand     "right" or "left", if the skeleton is a right one
    fit      what the fit found, if there was one
    """

    joints: Array
    network: Array
    crop: NDArray[np.float32]
    cube_mm: float
    hand: Side
    fit: FittedHand | None

    @property
    def joints_mm(self) -> Array:
        """(K, 3) mm from the crop centre."""
        return np.asarray(self.joints * self.cube_mm / 2)


@dataclass(frozen=True)
class FramePrediction(Prediction):
    """The hand in a crop of a whole frame.

    camera      of the frame
    center_uvd  (3,) crop centre in px, px, mm
    """

    camera: Camera
    center_uvd: Array

    @property
    def center_mm(self) -> Array:
        """(3,) crop centre in mm, camera axes."""
        return self.camera.unproject(self.center_uvd)

    @property
    def xyz(self) -> Array:
        """(K, 3) joints in mm, camera axes."""
        return np.asarray(self.center_mm + self.joints_mm)
