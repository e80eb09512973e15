"""The state of one tracked hand: its next search regions, its side, and when it is lost."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handpose.body.sides import Side, SideView, mirror_of
from handpose.estimate.candidates import SearchRegion
from handpose.estimate.estimator import HandEstimator
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.hand import HandEstimate
from handpose.fit.body import WorldPose
from handpose.fit.pose_confidence import Judge
from handpose.tracking.settings import FollowSettings, TrackSettings
from handpose.tracking.sizing import SizeKeeper
from handpose.tracking.smoothing import PoseFilter
from netlib.blob import Array

MOST_FOUND = 8  # hands in a frame
MAX_SIDE_CONFIDENCE = 0.99  # of a side that is not decided


@dataclass(frozen=True)
class SideState:
    """The state of a hand as one side: its last pose, the time of that in s, its smoothed pose, and
    its velocity (V,) (``WorldPose``).

    asked     s, when the network predicted it last
    settings  tuned numbers
    """

    estimate: HandEstimate
    time: float
    asked: float
    smooth: WorldPose
    filter: PoseFilter
    settings: FollowSettings
    velocity: Array | None = None

    @classmethod
    def first(cls, estimate: HandEstimate, time: float, settings: TrackSettings) -> SideState:
        """The state with the first pose."""
        filter = PoseFilter(settings.smooth)
        smooth = filter(estimate.body, time, estimate.error_mm)
        return cls(estimate, time, time, smooth, filter, settings.follow)

    def expected(self, time: float) -> WorldPose:
        """The expected body at a time."""
        if self.velocity is None:
            return self.estimate.body
        seconds = min(time - self.time, self.settings.max_extrapolation_s)
        return self.estimate.body.moved(self.settings.kept * seconds * self.velocity)

    def then(self, estimate: HandEstimate, time: float, asked: bool) -> SideState:
        """The state after one more pose, for which the network was ``asked`` or not.

        A pose whose fit did not start from the expected one changes only the velocity of the place,
        to that of the mean of the joints; and nothing if it is too far away.
        """
        way, new = _mean_joint(estimate) - _mean_joint(self.estimate), None
        weight = self.settings.new
        if estimate.is_tracked:
            new = self.estimate.body.step_to(estimate.body) / (time - self.time)
        elif np.linalg.norm(way) <= self.settings.max_jump_mm:
            unknown = np.zeros(6 + len(estimate.body.others))
            new = unknown if self.velocity is None else self.velocity.copy()
            new[:3] = way / (time - self.time)
        velocity = self.velocity
        if new is not None:
            velocity = new if velocity is None else weight * new + (1 - weight) * velocity
        smooth = self.filter(estimate.body, time, estimate.error_mm)
        asked_at = time if asked else self.asked
        return SideState(estimate, time, asked_at, smooth, self.filter, self.settings, velocity)


class Compared(NamedTuple):
    """How often both sides were compared, and the sum of the log-ratios of the costs: above 0 for a
    right hand.
    """

    times: int
    log_ratio: float

    @property
    def mean(self) -> float:
        """The mean log-ratio, for the likelier side."""
        return abs(self.log_ratio) / self.times


class Looks(NamedTuple):
    """The results of the finder's looks at a hand: its mean presence in the last looks, and the
    hand found in the last one, or None.
    """

    presence: float
    hand: FoundHand | None = None


class FrameHands:
    """The hands that a finder finds in a frame; it looks once, when it is first asked.

    view          the frame
    min_presence  of a hand
    is_known      True once it has looked
    """

    def __init__(self, finder: Finder, view: SideView, min_presence: float) -> None:
        self.view = view
        self._find = functools.cache(lambda: finder.hands_in(view, min_presence, MOST_FOUND))
        self.is_known = False

    @property
    def hands(self) -> list[FoundHand]:
        """The hands, the most certain first."""
        self.is_known = True
        return self._find()

    def near(self, place: Array, within_mm: float) -> FoundHand | None:
        """The hand that is nearest to a place (3,) in mm, but not farther than ``within_mm``."""
        apart = {float(np.linalg.norm(hand.middle - place)): hand for hand in self.hands}
        return apart[min(apart)] if apart and min(apart) < within_mm else None

    def weighted(self, place: Array, within_mm: float) -> SideView:
        """The frame, with the weights of the hand found near a place if the finder has looked."""
        near = self.near(place, within_mm) if self.is_known else None
        return self.view if near is None else self.view.weighted(near.weight)


class HandTrack:
    """One hand of a recording: its state while it is tracked, and what is kept while it is lost.

    id        of the hand; -1 until it has one
    sides     state for each side; both until the side is decided
    time      s, of its last pose
    begun     s, of its first pose
    credit    s, for which it may go on without a pose; it is lost without any
    reason    why it has no pose, or is lost
    sizes     the size of the hand, and how it is estimated
    decided   the side that was decided last, or None
    looks     what the finder found at its place
    settings  tuned numbers
    """

    def __init__(
        self,
        estimator: HandEstimator,
        settings: TrackSettings,
        estimates: Sequence[HandEstimate],
        time: float,
        size: float | None = None,
        side_prior: float = 0.0,
        presence: float = 1.0,
    ) -> None:
        """``side_prior``: prior log-ratio, above 0 for a right hand, below for a left one."""
        self.settings, self._estimator = settings, estimator
        self.id, self.credit, self.reason = -1, settings.follow.first_credit, ""
        self.time = self.begun = self._looked = time
        self.sizes = SizeKeeper(estimator.the_fitter, settings.size, size)
        self.looks = Looks(presence)
        best = _best(estimates)
        self._compared = Compared(0, side_prior)
        self.sides = {
            side: SideState.first(estimate, time, settings) for side, estimate in best.items()
        }
        self.decided: Side | None = self.hand if self.is_decided else None
        self._compare(best, time)

    def identify(self, id: int, before: HandTrack | None = None) -> None:
        """Give the hand its id; if it is one that was lost, with what is known of it."""
        self.id = id
        if before is not None:
            self.sizes = before.sizes
            self.decided = self.decided or before.decided

    @property
    def judge(self) -> Judge:
        """The judge of its poses."""
        return self._estimator.judge

    @property
    def size(self) -> float | None:
        """Its size relative to the skeleton, once it is known."""
        return self.sizes.size

    @property
    def is_tracked(self) -> bool:
        """False while it is lost."""
        return self.credit > 0

    @property
    def hand_chance(self) -> float:
        """The probability that this is a hand, by the finder or by its pose."""
        return max(self.looks.presence, self.best.estimate.chance)

    def look(self, frame: FrameHands) -> None:
        """Ask the finder whether the hand is there."""
        present, before = self.settings.present, self.looks.presence
        near = frame.near(self.place, present.same_mm)
        seen = near.presence if near else 0.0
        self.looks = Looks(before + present.look * (seen - before), near)

    def end(self, reason: str) -> None:
        """Stop tracking the hand."""
        self.credit, self.reason = 0.0, reason

    @property
    def hand(self) -> Side:
        """The more likely side."""
        if self.is_decided:
            return next(iter(self.sides))
        return "right" if self._compared.log_ratio >= 0 else "left"

    @property
    def best(self) -> SideState:
        """The state of the more likely side."""
        return self.sides[self.hand]

    @property
    def is_decided(self) -> bool:
        """True if the side is decided."""
        return len(self.sides) == 1

    @property
    def side_confidence(self) -> float:
        """The probability of the more likely side; 1 once it is decided."""
        if self.is_decided:
            return 1.0
        times = max(self._compared.times, self.settings.sides.min_times)
        mean = abs(self._compared.log_ratio) / times
        return min(self.judge.side_chance(mean), MAX_SIDE_CONFIDENCE)

    @property
    def place(self) -> Array:
        """The mean (3,) of its joints in mm, camera axes."""
        return self.best.estimate.xyz.mean(axis=0)

    def asks_network(self, time: float, before: float) -> bool:
        """Whether the network predicts the hand in the frame at a time, after one at ``before``."""
        was_missing, later_s = self.time < before, self.settings.present.later_s
        return was_missing or not self.is_decided or time - self.best.asked >= later_s

    def regions(self, time: float, before: float) -> list[SearchRegion]:
        """The search regions in a frame at a time, after one at ``before``."""
        asks = self.asks_network(time, before)
        return [
            self._region(side, seen.expected(time), asks_network=asks)
            for side, seen in self.sides.items()
        ]

    def other_regions(
        self, frame: FrameHands, estimates: Sequence[HandEstimate], time: float
    ) -> list[SearchRegion]:
        """Further search regions for a full fit, if the pose or the side is uncertain.

        They are about the palm that the network predicts from the finder's place, or from the crop
        without one; or else about the last pose.
        """
        sure = max((estimate.chance for estimate in estimates), default=0.0)
        follow, present = self.settings.follow, self.settings.present
        is_known = self.is_decided and sure >= follow.enough
        pause = present.later_s if is_known else present.soon_s
        if (self.is_decided and sure >= follow.sure) or time - self._looked < pause:
            return []
        regions = []
        for estimate in estimates:
            side, near = estimate.hand, frame.near(estimate.center_mm, present.same_mm)
            view, start = frame.view.of(side), estimate.view_uvd
            if near is not None:
                start = view.camera.project(near.middle * mirror_of(side))
            center = self._estimator.palm_at(view, start)
            regions.append(SearchRegion(center, side, self.sides[side].estimate.body, self.size))
        return regions or [
            self._region(side, seen.estimate.body) for side, seen in self.sides.items()
        ]

    def take(
        self,
        estimates: Sequence[HandEstimate],
        others: Sequence[HandEstimate] | None,
        time: float,
        before: float,
    ) -> bool:
        """Add the poses found in its regions and in others, the best for each side, in a frame at a
        time after one at ``before``; True if one is good enough.

        others  None if there were no other regions
        """
        seconds, asked = time - before, self.asks_network(time, before)
        follow = self.settings.follow
        self._looked = self._looked if others is None else time
        best = _best([*estimates, *(others or ())])
        self._compare(best, time)
        own = [best[side] for side in self.sides if side in best]
        if max((estimate.chance for estimate in own), default=0.0) < follow.enough:
            self.credit -= seconds
            return False
        for estimate in own:
            self.sides[estimate.hand] = self.sides[estimate.hand].then(estimate, time, asked)
        self.time, self.credit = time, min(self.credit + 2 * seconds, follow.most_credit)
        return True

    def _region(self, side: Side, body: WorldPose, *, asks_network: bool = True) -> SearchRegion:
        camera = self.sides[side].estimate.view_camera
        center = self._estimator.expected.center_of(body, camera)
        return SearchRegion(center, side, body, self.size, asks_network)

    def _compare(self, best: dict[Side, HandEstimate], time: float) -> None:
        """Add the log-ratio of a frame while the side is undecided, and decide it."""
        ratio = self._log_ratio_of(best)
        if self.is_decided or ratio is None:
            return
        times, total = self._compared
        self._compared = Compared(times + 1, total + ratio)
        seconds, s = time - self.begun, self.settings.sides
        enough = seconds >= s.min_s and self._compared.times >= s.min_times
        if enough and (self._compared.mean > s.clear or seconds >= s.max_s):
            self.sides = {self.hand: self.best}
            self.decided = self.hand

    def _log_ratio_of(self, best: dict[Side, HandEstimate]) -> float | None:
        """The log-ratio of one frame, above 0 for a right hand; None without a visible hand of
        either side.
        """
        enough = self.settings.follow.enough
        if len(best) < 2 or max(estimate.chance for estimate in best.values()) < enough:
            return None
        return self.judge.side_log_ratio(best["right"].cost, best["left"].cost)


def _mean_joint(estimate: HandEstimate) -> Array:
    """The mean (3,) of the joints in mm, in the view of its side."""
    return (estimate.view_center_mm + estimate.view_joints_mm).mean(axis=0)


def _best(estimates: Sequence[HandEstimate]) -> dict[Side, HandEstimate]:
    """The best pose of each side."""
    best: dict[Side, HandEstimate] = {}
    for estimate in estimates:
        if (
            estimate.hand not in best
            or estimate.selection_cost < best[estimate.hand].selection_cost
        ):
            best[estimate.hand] = estimate
    return best
