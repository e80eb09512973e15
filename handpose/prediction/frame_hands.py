"""The hands near places of a frame: crops go to the palms that the net sees, and the likeliest hands are told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.data.flying_pixels import clear_crop
from handpose.facts.cameras import Camera
from handpose.facts.sides import Side
from handpose.prediction import finding
from handpose.prediction.crop_hands import CropHands, Place, doubt
from handpose.prediction.options import Fit
from handpose.prediction.prediction import FramePrediction
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

# A crop is moved no farther than this from where it was first. Even if the nearest thing is taken for the hand, nine of
# ten are within 55 mm of its middle (finding.py): a prediction that wants it farther away has gone astray.
LARGEST_MOVE_MM = 60.0
KEEP = 3  # of the places that were fitted fast, so many are fitted by the plan
ODDS_MM = 4.0  # of strangeness, that the logarithm of the locator's odds is worth


class FrameHands:
    """Looks for hands near places of frames, and chooses between places and between sides.

    crops     what sees them
    skeleton  of the hands
    sides     that they may be of
    refine    how often a crop is moved to the palm that was predicted in it
    plan      of the fit, or "no"
    """

    def __init__(self, crops: CropHands, skeleton: Skeleton, sides: tuple[Side, ...], refine: int, plan: Fit) -> None:
        self._crops, self._skeleton, self._sides, self._refine, self._plan = crops, skeleton, sides, refine, plan

    def near(
        self, depth: NDArray[np.generic], camera: Camera, starts: Sequence[Array], odds: Sequence[float], *, find: bool
    ) -> list[FramePrediction]:
        """The hands at the likeliest of some places of a frame (height, width) in mm, the likeliest first.

        starts  (3,) px, px, mm each
        odds    logarithms of the odds that there is a hand
        find    nobody said where one is: crops about the places themselves are looked at, too, and ``KEEP`` hands told

        Raises DataError if all places are out of sight, or no hand is before the camera; NetlibError.
        """
        hands = self._likeliest(depth, camera, starts, odds, find)
        before = [hand for hand in hands if (hand.xyz[:, 2] > 0).all()]
        if not before:
            raise DataError(f"a pose is predicted in which a joint is at a depth of {hands[0].xyz[:, 2].min():.0f} mm, "
                            "behind the camera")  # fmt: skip
        return before

    def _likeliest(
        self, depth: NDArray[np.generic], camera: Camera, starts: Sequence[Array], odds: Sequence[float], find: bool
    ) -> list[FramePrediction]:
        """The hand of each of the ``KEEP`` likeliest places; of one if nobody has to ``find`` it."""
        places = self._places(depth, camera, starts, odds, both=find and self._plan != "no")
        if self._plan == "no":
            return self._crops.hands(places, camera, "no")[:1]
        if len(places) == 1:
            return self._crops.hands(places, camera, self._plan)
        by_sight = sorted(zip(self._crops.hands(places, camera, "fast"), places), key=lambda one: _unlikely(*one))
        best: dict[tuple[float, ...], Place] = {}
        for _, place in by_sight:
            best.setdefault(tuple(place.center_uvd), place)
        likely = list(best.values())[: KEEP if find else 1]
        again = [place._replace(side=side) for place in likely for side in self._sides]
        hands, sides = self._crops.hands(again, camera, self._plan), len(self._sides)
        told = [min(hands[i : i + sides], key=doubt) for i in range(0, len(hands), sides)]
        return [found for found, _ in sorted(zip(told, likely), key=lambda one: _unlikely(*one))]

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
                first = Place(clear_crop(depth, start, self._crops.cube_mm, camera), start, self._sides[0], likely)
            except DataError as error:
                last = error
                continue
            for side in self._sides:
                own = first._replace(side=side)
                moved = self._centred(depth, camera, own)
                places += [own, moved] if both and moved is not own else [moved]
            if self._plan == "no":
                break  # nobody could choose
        if last is not None and not places:
            raise last
        return places

    def _centred(self, depth: NDArray[np.generic], camera: Camera, place: Place) -> Place:
        """The crop about the palm that is predicted from a place; the place itself where it is there already."""
        start, side = place.center_uvd, place.side
        for _ in range(self._refine):
            joints = self._crops.network(place.crop, side)
            there = finding.recenter(joints, self._skeleton, place.center_uvd, self._crops.cube_mm, camera, side)
            if np.array_equal(there, place.center_uvd):
                break  # it would stay
            far = np.linalg.norm(camera.unproject(there) - camera.unproject(start))
            if not (far < LARGEST_MOVE_MM and there[2] > self._crops.cube_mm / 2):
                break  # a prediction gone astray
            try:
                place = place._replace(crop=clear_crop(depth, there, self._crops.cube_mm, camera), center_uvd=there)
            except DataError:  # out of sight
                break
        return place


def _unlikely(found: FramePrediction, place: Place) -> float:
    """What chooses between places: how little they are a hand, by the fit, and how little by the locator."""
    return (found.fit.strangeness if found.fit else 0.0) - ODDS_MM * place.odds
