"""Predictor: the joints of a hand in a crop, or in a whole depth frame.

predictor = load_predictor(KINECT2)   # the packaged weights, and the fit to the depth
found = predictor.in_frame(depth)     # depth (424, 512) in mm, 0 where nothing was read
found.xyz                             # (K, 3) mm in camera axes
found.fit.confidence                  # ... and how sure they are
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import SIZE
from handpose.data.depth_images import check_unit, depth_image, numbers
from handpose.depth_fit.body import FleshModel
from handpose.depth_fit.fit import DepthFitter
from handpose.depth_fit.network_errors import NetworkErrors
from handpose.facts.cameras import NYU, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.facts.sides import SIDES, Side, SoughtSide
from handpose.prediction import finding
from handpose.prediction.crop_hands import CropHands, Place, doubt
from handpose.prediction.frame_hands import FrameHands
from handpose.prediction.locator import Locator
from handpose.prediction.nets import cube_of, hand_layer, is_hand
from handpose.prediction.options import Fit, check_options
from handpose.prediction.prediction import FramePrediction, Prediction
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.net import Net

ALONE_MM = 750.0  # a crop without its frame is taken to be of the middle of the image, so far away; larger ones farther


class Predictor:
    """A net that sees the joints of a hand in a crop, and what it takes to use it on crops and on whole frames.

    net      its input is the blob depth, its joints are the blob pred, which a HandModel computes
    camera   of the frames; one without a size takes frames of any
    cube_mm  edge of the cube around the body; None: NYU's, if it is a hand
    hand     which it is, in an image that is not mirrored; "either" tries both and takes the one that explains the
             picture better, which needs a fit
    refine   how often the crop of a frame is moved to the palm that was predicted in it; 0 for nets whose training
             crops are not centred as NYU's are (ICVL's)
    fit      move the predicted hand until it explains the depth (``handpose.depth_fit``): the plan, or "no"
    errors   of the net, where somebody has measured them (``read_errors``)
    locator  says where hands are in a frame; without one, the nearest thing is taken for the hand

    Another body than a hand, which its skeleton tells, is not searched for, is no left or right one, and its crops stay
    where they are: in a frame somebody has to say where it is.

    A net knows the hand of its training data: of NYU and of the synthetic hands a right hand. Raises NetlibError for a
    net without these blobs or without a HandModel, for a fit of a skeleton without flesh, and for options that are
    none.
    """

    def __init__(
        self, net: Net, camera: Camera = NYU, *, cube_mm: float | None = None, hand: SoughtSide = "right",
        refine: int = 3, fit: Fit = "no", errors: NetworkErrors | None = None, locator: Locator | None = None,
    ) -> None:  # fmt: skip
        check_options(cube_mm=cube_mm, hand=hand, refine=refine, fit=fit)
        for name in ("depth", "pred"):
            if name not in net.blobs:
                raise NetlibError(
                    f"{net.source}: no blob {name!r}; expected a net with the input depth and the output pred"
                )
        layer = hand_layer(net)
        if layer is None:
            raise NetlibError(f"{net.source}: no HandModel layer, so the skeleton is unknown")
        if hand == "either" and fit == "no":
            raise NetlibError("only a fit can tell which hand it is; expected fit fast or accurate, or left or right")
        self.net, self.skeleton, self.camera = net, layer.skeleton, camera
        self.is_hand = is_hand(layer.skeleton)
        if hand == "left" and not self.is_hand:
            raise NetlibError(f"skeleton {self.skeleton.name!r} is no hand, so there is no left one")
        self.cube_mm = cube_of(self.skeleton, cube_mm)
        self.refine, self.fit, self.locator = refine if self.is_hand else 0, fit, locator
        self.sides: tuple[Side, ...] = (hand,) if hand != "either" else SIDES if self.is_hand else ("right",)
        self.fitter = None if fit == "no" else DepthFitter(FleshModel(self.skeleton, self.cube_mm / 2), errors)

    @property
    def _crops(self) -> CropHands:
        return CropHands(self.net, self.cube_mm, self.fitter)

    @property
    def _frames(self) -> FrameHands:
        return FrameHands(self._crops, self.skeleton, self.sides, self.refine, self.fit)

    def in_crop(self, depth: NDArray[np.floating]) -> Prediction:
        """The hand in a crop (128, 128) in [-1, 1]; what is masked is background. Raises DataError, NetlibError."""
        image = numbers(depth, "crop", 1)
        if image.shape != (SIZE, SIZE):
            raise DataError(f"crop of shape {image.shape}, expected ({SIZE}, {SIZE})")
        seen = image.astype(np.float32)
        low, high = float(seen.min()), float(seen.max())
        if not -1 <= low <= high <= 1:
            what = "that are not numbers" if np.isnan(low) else f"from {low:g} to {high:g}"
            raise DataError(f"crop with values {what}, expected -1 to 1")
        camera, middle = self.alone()
        places = [Place(seen, middle, side) for side in self.sides]
        found = min(self._crops.hands(places, camera, self.fit), key=doubt)
        return Prediction(**{field.name: getattr(found, field.name) for field in dataclasses.fields(Prediction)})

    def alone(self) -> tuple[Camera, Array]:
        """Camera and centre (3,) that a crop without its frame is taken to have."""
        camera = self.camera
        if not camera.width:
            camera = dataclasses.replace(camera, width=round(2 * camera.u0), height=round(2 * camera.v0))
        return camera, np.array([camera.u0, camera.v0, ALONE_MM * max(1.0, self.cube_mm / CUBE_MM)])

    def in_frame(self, depth: NDArray[np.generic], center: Sequence[float] | Array | None = None) -> FramePrediction:
        """The hand in a depth frame (height, width) in mm, 0 or masked where nothing was read.

        center  where to look first, as for ``start``. Without it, and with a locator and a fit, every place that the
                locator tells is fitted fast, and those that look most like a hand by the plan. Of the sides in one
                crop the one with less doubt is taken, of places the one that is less strange and likelier

        Raises UnitError for depths in another unit, DataError, NetlibError.
        """
        depth = _in_mm(depth)
        camera = self._camera_of(depth)
        if center is None and not self.is_hand:
            raise DataError(f"skeleton {self.skeleton.name!r} is no hand, and only hands are searched for")
        if center is None and self.locator is not None:
            located = self.locator.hands(depth, camera)
            starts = list(camera.project(located.center))
            return self._frames.near(depth, camera, starts, list(located.odds), find=True)[0]
        return self._frames.near(depth, camera, [self._start(depth, center)], [0.0], find=False)[0]

    def hands_at(
        self, depth: NDArray[np.generic], starts: Sequence[Array], odds: Sequence[float]
    ) -> list[FramePrediction]:
        """The hands at places where a locator saw some, as ``in_frame`` looks at them, the likeliest first.

        starts  (3,) px, px, mm each
        odds    logarithms of the odds that there is a hand

        Raises DataError if all places are out of sight, NetlibError.
        """
        depth = _in_mm(depth)
        return self._frames.near(depth, self._camera_of(depth), starts, odds, find=True)

    def start(self, depth: NDArray[np.generic], center: Sequence[float] | Array | None = None) -> Array:
        """Where to look first: the crop centre (3,), u, v in px and d in mm. Raises DataError.

        center  (u, v, d) is taken as it is; (u, v) gets the depth that is seen there; without it, the likeliest hand of
                the locator, or the nearest thing
        """
        return self._start(_in_mm(depth), center)

    def _start(self, depth: NDArray[np.generic], center: Sequence[float] | Array | None) -> Array:
        """The same in a frame that is known to be in mm."""
        if center is None:
            camera = self._camera_of(depth)
            if self.locator is not None:
                return camera.project(self.locator.hands(depth, camera).center[0])
            return finding.find_hand(depth, camera)
        place = _center(center)
        return place if len(place) == 3 else finding.depth_around(depth, *place)

    def _camera_of(self, depth: NDArray[np.generic]) -> Camera:
        """The camera, with the frame's size if it has none."""
        if self.camera.width:
            return self.camera
        return dataclasses.replace(self.camera, width=depth.shape[1], height=depth.shape[0])


def _in_mm(depth: object) -> NDArray[np.generic]:
    """A depth image in mm, 0 where it is masked. Raises UnitError, DataError."""
    image = depth_image(depth)
    check_unit(image)
    return image


def _center(center: object) -> Array:
    """(u, v) or (u, v, d) as an array. Raises DataError."""
    try:
        place = np.asarray(center, dtype=np.float64)
    except (TypeError, ValueError):
        place = np.zeros(0)
    if place.shape not in ((2,), (3,)) or not np.isfinite(place).all():
        raise DataError(f"center {center}, expected two or three finite numbers: u, v in px or u, v, d in px, px, mm")
    return place
