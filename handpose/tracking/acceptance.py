"""Which places and tracked objects are accepted as hands.

The locator and the rejection score judge independently. A new hand needs both. A tracked one is dropped by a high
score, or by an improbable place with a moderate one: the locator fails on poses that it was rarely trained on. Both are
dropped if they are flat.
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

# Limits of the rejection score of new and of tracked hands. In synthetic scenes with three cameras 92% of 187 hands are
# below 100 mm and 99% below 135 mm; of other things that the detector offers, the lowest has 113 mm. Before the search,
# fitted fast at the place itself, the hands that are accepted later have at most 116 mm.
REJECT_NEW_MM, REJECT_FIRST_MM, REJECT_MM = 100.0, 120.0, 135.0
MIN_SURROUNDINGS = 0.25  # share of the readings in a crop that are not the hand's: fewer do not mislead the fit
# A place is fitted again only if a first fast fit, judged in its frame, has this confidence. The first fits of 27 hands
# that were accepted in six real and ten synthetic recordings have at least 0.42, those of three quarters of the refused
# places less than 0.1.
ENOUGH_FIRST = ENOUGH / 3
# Share of the readings on a hand that are in one plane (``share_in_a_plane``): at most 0.68 in 680 frames of four
# cameras, and 0.82 or more on cut-outs of one depth that were taken for hands. Depths in large steps, as structured
# light has them far away, are not in these frames.
MAX_IN_A_PLANE = 0.75
LIKELY_ALONE = 0.9  # minimum probability of a place that is fitted without its surroundings


class Offer(NamedTuple):
    """The poses found at a place, as hands of each side; without any, the reason.

    alone  True if they were found without the surroundings of the hand
    """

    estimates: list[Hand]
    reason: str = ""
    alone: bool = False


class Acceptance:
    """Judges places by the predictor, the estimator and the detector of a tracker."""

    def __init__(self, predictor: Predictor, estimator: PoseEstimator, detector: Detector) -> None:
        self.predictor, self.estimator, self.detector = predictor, estimator, detector

    def hands_at(self, depth: NDArray[np.float32], place: Array) -> Offer:
        """The poses near a place (3,) in mm.

        A place that is refused with everything in its crop is judged again without the surroundings, if it has any.
        """
        offer = self._among_others(depth, place)
        return offer if offer.estimates else self._alone(depth, place) or offer

    def _alone(self, depth: NDArray[np.float32], place: Array) -> Offer | None:
        """The poses near a place (3,) in mm whose surroundings are removed; None if no hand is found so.

        The poses are judged among their surroundings, as they will be reported. Cheap tests come first, because most
        refused places are no hands.
        """
        center = self.predictor.camera.project(place)
        if self.estimator.surroundings(depth, center) < MIN_SURROUNDINGS:
            return None
        if self.detector.probability_at(depth, place) < LIKELY_ALONE:
            return None
        seen: list[Hand] = []
        for plan, enough in ((FAST, ENOUGH_FIRST), (FAST, ENOUGH_FIRST), (ACCURATE, ENOUGH)):
            seen = self._sides_at(depth, center, plan, alone=True)
            chances = [hand.judged(depth).chance for hand in seen]
            if max(chances, default=0.0) < enough:
                return None
            best = seen[int(np.argmax(chances))]
            center = self.estimator.center_of(best.body, best.hand)
        return None if self.doubt(depth, best, REJECT_NEW_MM, needs_both=True) else Offer(seen, alone=True)

    def _among_others(self, depth: NDArray[np.float32], place: Array) -> Offer:
        """The poses near a place (3,) in mm, with everything in its crop.

        A fast prediction at the place itself comes first. It rejects most of the other objects before the slow search.
        """
        start = self.predictor.camera.project(place)
        first = self._sides_at(depth, start, FAST)
        score = min((hand.rejection_score for hand in first), default=np.inf)
        if score > REJECT_FIRST_MM:
            return Offer([], _unlike(score, REJECT_FIRST_MM))
        if (confidence := _confidence(first, depth)) < ENOUGH_FIRST:
            return Offer([], uncertain(confidence))
        try:
            found = self.predictor.pipeline.in_frame(depth, self.predictor.camera, [start], [0.0], search=True)[0]
        except DataError:
            return Offer([], "it is out of sight")
        if found.rejection_score > REJECT_MM:
            return Offer([], _unlike(found.rejection_score, REJECT_MM))
        seen = self._sides_at(depth, found.center_uvd, ACCURATE)
        if (confidence := _confidence(seen, depth)) < ENOUGH:
            return Offer([], uncertain(confidence))
        best = min(seen, key=lambda estimate: estimate.uncertainty)
        reason = self.doubt(depth, best, REJECT_NEW_MM, needs_both=True)
        return Offer([] if reason else seen, reason)

    def doubt(
        self, depth: NDArray[np.float32], estimate: Hand, limit_mm: float = REJECT_MM, *, needs_both: bool = False
    ) -> str:
        """Why an estimate is no hand; empty if it is one.

        needs_both  the place must be probable whatever the score
        """
        score = estimate.rejection_score
        if score >= limit_mm:
            return _unlike(score, limit_mm)
        if self.is_flat(depth, estimate):
            return f"{NO_HAND} (it is flat)"
        if not needs_both and score < REJECT_NEW_MM:
            return ""
        chance = self.detector.probability(depth, estimate.center_mm)
        return "" if chance >= LIKELY else f"{NO_HAND} (probability {chance:.0%}, rejection score {score:.0f} mm)"

    def is_flat(self, depth: NDArray[np.float32], estimate: Hand) -> bool:
        """True if an estimate is a flat object with the outline of a hand."""
        return self.estimator.share_in_a_plane(depth, estimate) > MAX_IN_A_PLANE

    def _sides_at(
        self, depth: NDArray[np.float32], center_uvd: Array, plan: Plan, *, alone: bool = False
    ) -> list[Hand]:
        """The poses in a crop about a centre (3,), as a hand of each side; none if it is outside the image."""
        regions = [SearchRegion(center_uvd, side, alone=alone) for side in self.predictor.sides]
        return [estimate for estimate in self.estimator.estimate(depth, regions, plan) if estimate is not None]


def _confidence(hands: list[Hand], depth: NDArray[np.float32]) -> float:
    """The highest confidence of hands, judged in their frame."""
    return max((hand.judged(depth).chance for hand in hands), default=0.0)


def _unlike(score: float, limit_mm: float) -> str:
    return f"{NO_HAND} (rejection score {score:.0f} mm, limit {limit_mm:.0f} mm)"
