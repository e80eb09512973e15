"""Which places are accepted as new hands: those with a sure pose, a low rejection score and a probable place.

The locator and the rejection score judge independently.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.estimate.estimator import SearchRegion
from handpose.estimate.hand import Hand
from handpose.estimate.predictor import Predictor
from handpose.fit.search import ACCURATE, FAST, Plan
from handpose.tracking.detector import Detector
from handpose.tracking.hand_track import ENOUGH
from handpose.tracking.pose_estimator import LIKELY, PoseEstimator
from handpose.tracking.reasons import NO_HAND, uncertain
from netlib.blob import Array
from netlib.errors import DataError

# Limits of the rejection score: of a new hand, of the first fast fit at a place, and of the search there. In synthetic
# scenes with three cameras 92% of 187 hands are below 100 mm and 99% below 135 mm; of other things that the detector
# offers, the lowest has 113 mm. First fits of the hands that are accepted later have at most 116 mm.
REJECT_NEW_MM, REJECT_FIRST_MM, REJECT_MM = 100.0, 120.0, 135.0
# A place is fitted again only if a first fast fit, judged in its frame, has this confidence. The first fits of 27 hands
# that were accepted in six real and ten synthetic recordings have at least 0.42, those of three quarters of the refused
# places less than 0.1.
ENOUGH_FIRST = ENOUGH / 3


class Offer(NamedTuple):
    """The poses found at a place, as hands of each side; without any, the reason."""

    estimates: list[Hand]
    reason: str = ""


class Acceptance:
    """Judges places by the predictor, the estimator and the detector of a tracker."""

    def __init__(self, predictor: Predictor, estimator: PoseEstimator, detector: Detector) -> None:
        self.predictor, self.estimator, self.detector = predictor, estimator, detector

    def hands_at(self, depth: NDArray[np.float32], place: Array) -> Offer:
        """The poses near a place (3,) in mm.

        A fast prediction at the place itself comes first. It rejects most of the other objects before the slow search.
        """
        start = self.predictor.camera.project(place)
        first = self._sides_at(depth, start, FAST)
        score = min((hand.rejection_score for hand in first), default=np.inf)
        if score > REJECT_FIRST_MM:
            return Offer([], _unlike(score, REJECT_FIRST_MM))
        if (confidence := _confidence(first)) < ENOUGH_FIRST:
            return Offer([], uncertain(confidence))
        try:
            found = self.predictor.pipeline.in_frame(depth, self.predictor.camera, [start], [0.0], search=True)[0]
        except DataError:
            return Offer([], "it is out of sight")
        if found.rejection_score > REJECT_MM:
            return Offer([], _unlike(found.rejection_score, REJECT_MM))
        seen = self._sides_at(depth, found.center_uvd, ACCURATE)
        if (confidence := _confidence(seen)) < ENOUGH:
            return Offer([], uncertain(confidence))
        best = min(seen, key=lambda estimate: estimate.uncertainty)
        if (score := best.rejection_score) >= REJECT_NEW_MM:
            return Offer([], _unlike(score, REJECT_NEW_MM))
        chance = self.detector.probability(depth, best.center_mm)
        return Offer(seen) if chance >= LIKELY else Offer([], f"{NO_HAND} (probability {chance:.0%})")

    def _sides_at(self, depth: NDArray[np.float32], center_uvd: Array, plan: Plan) -> list[Hand]:
        """The poses in a crop about a centre (3,), as a hand of each side; none if it is outside the image."""
        regions = [SearchRegion(center_uvd, side) for side in self.predictor.sides]
        return [one for one in self.estimator.estimate(depth, regions, plan) if one is not None]


def _confidence(hands: list[Hand]) -> float:
    """The highest confidence of hands."""
    return max((hand.chance for hand in hands), default=0.0)


def _unlike(score: float, limit_mm: float) -> str:
    return f"{NO_HAND} (rejection score {score:.0f} mm, limit {limit_mm:.0f} mm)"
