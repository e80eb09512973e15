"""Predictor: the joints of a hand in a crop, or in a whole depth frame.

predictor = load_predictor(KINECT2)   # the packaged weights, and the fit to the depth
found = predictor.in_frame(depth)     # depth (424, 512) in mm, 0 where nothing was read
found.xyz                             # (K, 3) mm in camera axes
found.fit.confidence                  # ... and how sure they are
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import SIZE, crop
from handpose.data.depth_images import check_unit, depth_image, numbers
from handpose.facts.cameras import NYU, Camera
from handpose.facts.cubes import CUBES_MM
from handpose.facts.nyu import CUBE_MM
from handpose.facts.sides import SIDES, SOUGHT_SIDES, Side, SoughtSide, as_right, mirror_of, seen_as_right
from handpose.fitting.depth.body import GIRTH, FleshModel
from handpose.fitting.depth.fit import DepthFitter
from handpose.fitting.depth.network_errors import NetworkErrors
from handpose.fitting.depth.strangeness import strangeness
from handpose.flesh.render import Capsules
from handpose.predicting import finding
from handpose.predicting.locator import Locator
from handpose.predicting.many import fit_crops
from handpose.predicting.nets import hand_layer, is_hand
from handpose.predicting.prediction import FittedHand, FramePrediction, Prediction
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, did_you_mean
from netlib.net import Net

Fit = Literal["no", "fast", "accurate"]

# A crop is moved no farther than this from where it was first. Even if the nearest thing is taken for the hand, nine of
# ten are within 55 mm of its middle (finding.py): a prediction that wants it farther away has gone astray.
LARGEST_MOVE_MM = 60.0
KEEP = 3  # of the places that were fitted fast, so many are fitted by the plan
ODDS_MM = 4.0  # of strangeness, that the logarithm of the locator's odds is worth
ALONE_MM = 750.0  # a crop without its frame is taken to be of the middle of the image, so far away; larger ones farther
MOST_REFINE = 100  # a crop that has not come to rest after so many moves goes round in a circle


class Place(NamedTuple):
    """A crop (128, 128) in [-1, 1], its centre (3,) in px, px, mm, which hand it is to be seen as, and its odds."""

    crop: NDArray[np.float32]
    center_uvd: Array
    side: Side
    odds: float = 0.0  # logarithm, that there is a hand, says the locator


class Predictor:
    """A net that sees the joints of a hand in a crop, and what it takes to use it on crops and on whole frames.

    net      its input is the blob depth, its joints are the blob pred, which a HandModel computes
    camera   of the frames; one without a size takes frames of any
    cube_mm  edge of the cube around the hand
    hand     which it is, in an image that is not mirrored; "either" tries both and takes the one that explains the
             picture better, which needs a fit
    refine   how often the crop of a frame is moved to the palm that was predicted in it; 0 for nets whose training
             crops are not centred as NYU's are (ICVL's)
    fit      move the predicted hand until it explains the depth (``handpose.fitting.depth``): the plan, or "no"
    errors   of the net, where somebody has measured them (``read_errors``)
    locator  says where hands are in a frame; without one, the nearest thing is taken for the hand

    Another body than a hand, which its skeleton tells, is not searched for, is no left or right one, and its crops stay
    where they are: in a frame somebody has to say where it is.

    A net knows the hand of its training data: of NYU and of the synthetic hands a right hand. Raises NetlibError for a
    net without these blobs or without a HandModel, for a fit of a skeleton without flesh, and for options that are
    none.
    """

    def __init__(
        self, net: Net, camera: Camera = NYU, *, cube_mm: float = CUBE_MM, hand: SoughtSide = "right", refine: int = 3,
        fit: Fit = "no", errors: NetworkErrors | None = None, locator: Locator | None = None,
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
        self.cube_mm, self.refine, self.fit, self.locator = cube_mm, refine if self.is_hand else 0, fit, locator
        self.sides: tuple[Side, ...] = (hand,) if hand != "either" else SIDES if self.is_hand else ("right",)
        self.fitter = None if fit == "no" else DepthFitter(FleshModel(self.skeleton, cube_mm / 2), errors)

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
        found = min(self._hands([Place(seen, middle, side) for side in self.sides], camera, self.fit), key=_doubt)
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
            return self._hands_near(depth, starts, list(located.odds), find=True)[0]
        return self._hands_near(depth, [self._start(depth, center)], [0.0], find=False)[0]

    def hands_at(
        self, depth: NDArray[np.generic], starts: Sequence[Array], odds: Sequence[float]
    ) -> list[FramePrediction]:
        """The hands at places where a locator saw some, as ``in_frame`` looks at them, the likeliest first.

        starts  (3,) px, px, mm each
        odds    logarithms of the odds that there is a hand

        Raises DataError if all places are out of sight, NetlibError.
        """
        return self._hands_near(_in_mm(depth), starts, odds, find=True)

    def _hands_near(
        self, depth: NDArray[np.generic], starts: Sequence[Array], odds: Sequence[float], find: bool
    ) -> list[FramePrediction]:
        """Those hands of the likeliest places that are before the camera. Raises DataError if none is."""
        hands = self._likeliest(depth, starts, odds, find)
        before = [hand for hand in hands if (hand.xyz[:, 2] > 0).all()]
        if not before:
            raise DataError(f"a hand is predicted in which a joint is at a depth of {hands[0].xyz[:, 2].min():.0f} mm, "
                            "behind the camera")  # fmt: skip
        return before

    def _likeliest(
        self, depth: NDArray[np.generic], starts: Sequence[Array], odds: Sequence[float], find: bool
    ) -> list[FramePrediction]:
        """The hand of each of the ``KEEP`` likeliest places; of one if nobody has to ``find`` it."""
        camera = self._camera_of(depth)
        places = self._places(depth, camera, starts, odds, both=find and self.fit != "no")
        if self.fit == "no":
            return self._hands(places, camera, "no")[:1]
        if len(places) == 1:
            return self._hands(places, camera, self.fit)
        by_sight = sorted(zip(self._hands(places, camera, "fast"), places), key=lambda one: _unlikely(*one))
        best: dict[tuple[float, ...], Place] = {}
        for _, place in by_sight:
            best.setdefault(tuple(place.center_uvd), place)
        likely = list(best.values())[: KEEP if find else 1]
        again = [place._replace(side=side) for place in likely for side in self.sides]
        hands, sides = self._hands(again, camera, self.fit), len(self.sides)
        told = [min(hands[i : i + sides], key=_doubt) for i in range(0, len(hands), sides)]
        return [found for found, _ in sorted(zip(told, likely), key=lambda one: _unlikely(*one))]

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

    def _places(
        self, depth: NDArray[np.generic], camera: Camera, starts: Sequence[Array], odds: Sequence[float], both: bool
    ) -> list[Place]:
        """The crops about the palms that are predicted from these starts, as hands of each side.

        both  and the crops about the starts themselves: some hands are lost on the way to the palm

        Raises DataError if all starts are out of sight.
        """
        places, last = [], None
        for start, likely in zip(starts, odds):
            try:
                first = Place(crop(depth, start, self.cube_mm, camera), start, self.sides[0], likely)
            except DataError as error:
                last = error
                continue
            for side in self.sides:
                own = first._replace(side=side)
                moved = self._centred(depth, camera, own)
                places += [own, moved] if both and moved is not own else [moved]
            if self.fit == "no":
                break  # nobody could choose
        if last is not None and not places:
            raise last
        return places

    def _centred(self, depth: NDArray[np.generic], camera: Camera, place: Place) -> Place:
        """The crop about the palm that is predicted from a place; the place itself where it is there already."""
        start, side = place.center_uvd, place.side
        for _ in range(self.refine):
            joints = self._network(place.crop, side)
            there = finding.recenter(joints, self.skeleton, place.center_uvd, self.cube_mm, camera, side)
            if np.array_equal(there, place.center_uvd):
                break  # it would stay
            far = np.linalg.norm(camera.unproject(there) - camera.unproject(start))
            if not (far < LARGEST_MOVE_MM and there[2] > self.cube_mm / 2):
                break  # a prediction gone astray
            try:
                place = place._replace(crop=crop(depth, there, self.cube_mm, camera), center_uvd=there)
            except DataError:  # out of sight
                break
        return place

    def _network(self, seen: NDArray[np.float32], side: Side) -> Array:
        """The joints (K, 3) in half-cubes that the net alone predicts in a crop."""
        shown = np.ascontiguousarray(as_right(seen, side))
        joints = self.net.forward(blobs=["pred"], depth=shown[None, None])["pred"].reshape(-1, 3).astype(np.float64)
        if not np.isfinite(joints).all():
            raise NetlibError(f"{self.net.source}: predicts joints that are not finite; check its weights")
        return np.asarray(joints * mirror_of(side))

    def _hands(self, places: Sequence[Place], camera: Camera, plan: Fit) -> list[FramePrediction]:
        """The hands at some places, fitted by the plan."""
        found: dict[int, FramePrediction] = {}
        for side in self.sides:
            own = [i for i, place in enumerate(places) if place.side == side]
            if own:
                found |= dict(zip(own, self._hands_of(side, [places[i] for i in own], camera, plan)))
        return [found[i] for i in range(len(places))]

    def _hands_of(self, side: Side, places: Sequence[Place], camera: Camera, plan: Fit) -> list[FramePrediction]:
        """The same, all of one side."""
        mirror, half = mirror_of(side), self.cube_mm / 2
        if self.fitter is None or plan == "no":
            network = [self._network(place.crop, side) for place in places]
            return [
                FramePrediction(joints, joints, place.crop, self.cube_mm, side, None, camera, place.center_uvd)
                for joints, place in zip(network, places)
            ]
        model = self.fitter.model
        crops, uvd = np.stack([place.crop for place in places]), np.stack([place.center_uvd for place in places])
        fit = fit_crops(self.net, self.fitter, crops, uvd, camera, plan, side=side)
        flesh = model.capsules(fit.x, np.zeros((len(places), 3)))
        whole, girth = model.whole_inputs_of(fit.x), np.exp(fit.x[:, GIRTH])
        strange = strangeness(model, fit, *seen_as_right(crops, uvd, camera, side))
        hands = []
        for n, place in enumerate(places):
            capsules = Capsules(flesh.a[[n]] * mirror, flesh.b[[n]] * mirror, flesh.radius_a[[n]], flesh.radius_b[[n]])
            hand = FittedHand(
                inputs=fit.inputs[n],
                whole=whole[n],
                size=float(fit.size[n]),
                girth=float(girth[n]),
                misfit=float(fit.misfit[n]),
                doubt=float(fit.doubt[n]),
                strangeness=float(strange[n]),
                error_mm=float(fit.error_mm[n]),
                confidence=float(fit.confidence[n]),
                capsules=capsules,
            )
            joints, network_joints = fit.joints[n] * mirror / half, fit.network[n] * mirror / half
            hands.append(FramePrediction(joints, network_joints, place.crop, self.cube_mm, side, hand, camera,
                                         place.center_uvd))  # fmt: skip
        return hands

    def _camera_of(self, depth: NDArray[np.generic]) -> Camera:
        """The camera, with the frame's size if it has none."""
        if self.camera.width:
            return self.camera
        return dataclasses.replace(self.camera, width=depth.shape[1], height=depth.shape[0])


def check_options(*, cube_mm: float, hand: str, refine: int, fit: str) -> None:
    """Raise NetlibError for options of a ``Predictor`` that are none."""
    for name, word, known in (("hand", hand, SOUGHT_SIDES), ("fit", fit, get_args(Fit))):
        if word not in known:
            raise NetlibError(f"{name}={word!r}{did_you_mean(str(word), known)}; expected {', '.join(known)}")
    least, most = CUBES_MM
    if not (isinstance(cube_mm, Real) and least <= cube_mm <= most):
        raise NetlibError(f"cube_mm={cube_mm!r}; expected {least:g} to {most:g} mm")
    check_whole("refine", refine, 0, MOST_REFINE)


def check_whole(name: str, value: object, least: int, most: int) -> None:
    """Raise NetlibError for a value of an argument that is no whole number from ``least`` to ``most``."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) <= most:
        raise NetlibError(f"{name}={value!r}; expected a whole number from {least} to {most}")


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


def _doubt(found: Prediction) -> float:
    """What chooses between a right and a left hand in one crop.

    Of 1,024 frames a fast fit is told by its doubt to be the right hand in 99%, by its misfit in 93%; an accurate one
    in 99.6% by either.
    """
    return found.fit.doubt if found.fit else 0.0


def _unlikely(found: FramePrediction, place: Place) -> float:
    """What chooses between places: how little they are a hand, by the fit, and how little by the locator."""
    return (found.fit.strangeness if found.fit else 0.0) - ODDS_MM * place.odds
