"""Predictor: the joints of a hand in a crop, or in a whole depth frame.

predictor = load_predictor(KINECT2)   # the packaged weights, and the fit to the depth
found = predictor.in_frame(depth)     # depth (424, 512) in mm, 0 where there is no reading
found.confidence                      # probability that the mean error of the joints is below 30 mm
found.xyz                             # (K, 3) mm in camera axes; NaN if the confidence is below 0.3
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property
from numbers import Integral, Real
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.sides import SIDES, SOUGHT_SIDES, Side, SideView, SoughtSide, mirror_of, pixel_of
from handpose.estimate.estimator import HandEstimator
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.hand import MIN_CONFIDENCE, HandEstimate, as_one_side
from handpose.estimate.nets import cube_of, is_hand, the_hand_layer
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.settings import Fit, FitSettings
from handpose.frames.cameras import NYU, Camera
from handpose.frames.crops import CUBES_MM, SIZE, numbers
from handpose.frames.images import check_unit, depth_image, without_dropouts
from handpose.frames.recording import sized
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, did_you_mean
from netlib.net import Net

# assumed depth of a crop without its frame, in the middle of the image; larger cubes farther
CROP_DEPTH_MM = 750.0
MOST = 3  # found hands that are fitted in a frame
PALM_MM = 15.0  # from the surface of the palm to its middle
MAX_REFINE = 100  # a crop that still moves after this many moves does not converge


class Predictor:
    """Predicts the hand in crops and in whole frames with one net.

    net      with the input blob depth and the output blob pred, which a HandModel computes
    camera   of the frames; one without a size accepts frames of any size
    cube_mm  edge of the cube around the body; default for hands: NYU's
    hand     side of the hand, in an image that is not mirrored; "either" fits both and takes the
             one whose fit costs less
    refine   maximum number of moves of a frame's crop to the palm predicted in it; 0 for nets whose
             training crops are not centred as NYU's (ICVL's)
    fit      "no", or the name of the plan by which the predicted pose is fitted to the depth
    fitter   of the net's body; by default one for a network with unknown errors
    finder   finds hands in frames, or a function that loads one when it is first used; without it,
             ``in_frame`` needs the hand's centre
    min_confidence  below it a hand has no joints (``HandEstimate.given``); 0 for all joints
    settings  tuned numbers; with a fitter its own

    Nets know the hand of their training data, which is a right hand in NYU and in the synthetic
    frames. A body other than a hand has no side and is not searched for: ``in_frame`` needs its
    centre, and the crop does not move.

    Raises NetlibError for a net without these blobs or without a HandModel, for a fit of a skeleton
    without a surface, and for invalid options.
    """

    def __init__(
        self,
        net: Net,
        camera: Camera = NYU,
        *,
        cube_mm: float | None = None,
        hand: SoughtSide = "right",
        refine: int = 3,
        fit: Fit = "no",
        fitter: DepthFitter | None = None,
        finder: Finder | Callable[[], Finder] | None = None,
        min_confidence: float = MIN_CONFIDENCE,
        settings: FitSettings = FitSettings(),
    ) -> None:
        check_options(
            cube_mm=cube_mm, hand=hand, refine=refine, fit=fit, min_confidence=min_confidence
        )
        if not isinstance(camera, Camera):
            what = type(camera).__name__
            raise NetlibError(f"camera is a {what}; expected a Camera, such as handpose.NYU")
        self.net, self.skeleton, self.camera = net, _skeleton_of(net), camera
        if hand == "either" and fit == "no":
            raise NetlibError(
                "only a fit can tell which hand it is; expected fit fast or accurate, or left or right"
            )
        self.is_hand = is_hand(self.skeleton)
        if hand == "left" and not self.is_hand:
            raise NetlibError(
                f"skeleton {self.skeleton.name!r} is not a hand, so there is no left one"
            )
        self.cube_mm = cube_of(self.skeleton, cube_mm)
        self.refine = refine if self.is_hand else 0
        self.sides: tuple[Side, ...] = (hand,) if hand != "either" else SIDES
        if not self.is_hand:
            self.sides = ("right",)
        self.settings = fitter.settings if fitter else settings
        self.plan = self.settings.search.plans.get(fit)
        self.fitter = None
        if self.plan is not None:
            model = CapsuleModel(self.skeleton, self.cube_mm / 2)
            self.fitter = fitter or DepthFitter(model, settings=self.settings)
        self.estimator = HandEstimator(
            net, self.cube_mm, self.sides, self.refine, self.fitter, self.plan, self.settings
        )
        self.min_confidence = min_confidence
        self._finder = finder

    @cached_property
    def finder(self) -> Finder | None:
        """The finder, loaded at the first access. Raises NetlibError."""
        return self._finder() if callable(self._finder) else self._finder

    def in_crop(self, depth: NDArray[np.floating]) -> HandEstimate:
        """The hand in a crop (128, 128) in [-1, 1]; masked pixels are background.

        Raises DataError, NetlibError.
        """
        image = numbers(depth, "crop", 1)
        if image.shape != (SIZE, SIZE):
            raise DataError(f"crop of shape {image.shape}, expected ({SIZE}, {SIZE})")
        crop = image.astype(np.float32)
        low, high = float(crop.min()), float(crop.max())
        if not -1 <= low <= high <= 1:
            what = "that are not numbers" if np.isnan(low) else f"from {low:g} to {high:g}"
            raise DataError(f"crop with values {what}, expected -1 to 1")
        camera = self.camera
        if not camera.width:
            camera = dataclasses.replace(
                camera, width=round(2 * camera.u0), height=round(2 * camera.v0)
            )
        center = np.array([camera.u0, camera.v0, CROP_DEPTH_MM * max(1.0, self.cube_mm / CUBE_MM)])
        found = as_one_side(self.estimator.in_crop(crop, camera, center), self.estimator.judge)
        return dataclasses.replace(found, in_frame=False).given(self.min_confidence)

    def in_frame(
        self, depth: NDArray[np.generic], center: Sequence[float] | Array | None = None
    ) -> HandEstimate:
        """The hand in a depth frame (height, width) in mm, 0 or masked where there is no reading.

        center  where the first crop is: u, v in px and d in mm, or u, v, where the depth is
                measured. Without it, of up to ``MOST`` hands that the finder finds, the one with
                the highest product of presence and confidence is given

        Raises UnitError for depths that cannot be mm, DataError, also if no hand is
        found, NetlibError.
        """
        depth = self._readings(depth)
        camera = sized(self.camera, depth.shape, "depth image")
        frame = SideView("right", camera, depth, depth).of(self.sides[0])
        if center is None and not self.is_hand:
            raise DataError(
                f"skeleton {self.skeleton.name!r} is not a hand, and only hands are searched for"
            )
        if center is not None:
            place = _center(center)
            start = place if len(place) == 3 else depth_around(depth, *place)
            place = pixel_of(start, camera, frame.side)
            hand = self.estimator.in_frame(frame, place)
            return as_one_side(hand, self.estimator.judge).given(self.min_confidence)
        found = self._found(frame)
        if self.plan is None:
            found = found[:1]
        hands = [self.at_found(frame, one) for one in found]
        return max(hands, key=lambda hand: hand.presence * max(hand.chance, 0.01)).given(
            self.min_confidence
        )

    def at_found(self, frame: SideView, found: FoundHand) -> HandEstimate:
        """The hand that a finder found in a frame, however sure, as one side.

        Raises DataError for a place outside the image, NetlibError.
        """
        place = frame.camera.project(found.middle * mirror_of(frame.side))
        hand = self.estimator.in_frame(frame.weighted(found.weight), place, is_middle=True)
        return dataclasses.replace(as_one_side(hand, self.estimator.judge), presence=found.presence)

    def _found(self, frame: SideView) -> list[FoundHand]:
        """The hands that the finder finds, the most certain first.

        Raises DataError without any, or a finder.
        """
        if self.finder is None:
            raise DataError("this predictor has no finder; give the hand's place (center)")
        if not (frame.depth > 0).any():  # type: ignore[operator]
            nearest = self.camera.min_range_mm
            raise DataError(f"no depth anywhere in the image, from {nearest:g} mm on")
        found = self.finder.hands_in(frame, most=MOST)
        if not found:
            raise DataError(
                "no hand is seen in this frame; if there is one, give its place (center)"
            )
        return found

    def _readings(self, depth: object) -> NDArray[np.generic]:
        """A depth image in mm, 0 where it is masked or nearer than the camera measures.

        Raises UnitError, DataError.
        """
        image = depth_image(depth)
        check_unit(image)
        return without_dropouts(self.camera.in_range(image))


def _skeleton_of(net: Net) -> Skeleton:
    """The hand of a net that estimates it from crops. Raises NetlibError for another net."""
    for name in ("depth", "pred"):
        if name not in net.blobs:
            raise NetlibError(
                f"{net.source}: no blob {name!r}; expected a net with the input depth and the output pred"
            )
    return the_hand_layer(net).skeleton


def check_options(
    *,
    cube_mm: float | None,
    hand: str,
    refine: int,
    fit: str,
    min_confidence: float = MIN_CONFIDENCE,
) -> None:
    """Raise NetlibError for invalid options of a ``Predictor``."""
    for name, word, known in (("hand", hand, SOUGHT_SIDES), ("fit", fit, get_args(Fit))):
        if word not in known:
            raise NetlibError(
                f"{name}={word!r}{did_you_mean(str(word), known)}; expected {', '.join(known)}"
            )
    low, high = CUBES_MM
    if cube_mm is not None and not (isinstance(cube_mm, Real) and low <= cube_mm <= high):
        raise NetlibError(f"cube_mm={cube_mm!r}; expected {low:g} to {high:g} mm")
    check_whole("refine", refine, 0, MAX_REFINE)
    check_probability("min_confidence", min_confidence)


def check_probability(name: str, value: float) -> None:
    """Raise NetlibError unless the argument ``name`` is a number from 0 to 1."""
    if not (isinstance(value, Real) and 0 <= value <= 1):
        raise NetlibError(f"{name}={value!r}; expected a number from 0 to 1")


def check_whole(name: str, value: object, low: int, high: int) -> None:
    """Raise NetlibError unless the argument ``name`` is a whole number from ``low`` to ``high``."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not low <= int(value) <= high:
        raise NetlibError(f"{name}={value!r}; expected a whole number from {low} to {high}")


def _center(center: object) -> Array:
    """(u, v) or (u, v, d) as an array. Raises DataError."""
    try:
        place = np.asarray(center, dtype=np.float64)
    except (TypeError, ValueError):
        place = np.zeros(0)
    if place.shape not in ((2,), (3,)) or not np.isfinite(place).all():
        raise DataError(
            f"center {center}, expected two or three finite numbers: u, v in px or u, v, d in px, px, mm"
        )
    return place


def depth_around(depth: NDArray[np.generic], u: float, v: float, reach: int = 8) -> Array:
    """Centre (3,) at pixel u, v with the median depth around it: u, v in px and d in mm.

    Raises DataError.
    """
    image = depth_image(depth)
    row, column = round(v), round(u)
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
        raise DataError(
            f"pixel {u:g}, {v:g} lies outside the image of {image.shape[1]} x {image.shape[0]}"
        )
    top, left = max(row - reach, 0), max(column - reach, 0)
    around = image[top : row + reach + 1, left : column + reach + 1]
    seen = around[np.isfinite(around) & (around > 0)]
    if not len(seen):
        raise DataError(f"no depth around pixel {u:g}, {v:g}")
    return np.array([u, v, np.median(seen) + PALM_MM])
