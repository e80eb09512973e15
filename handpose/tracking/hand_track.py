"""The state of one tracked hand: its next search regions, its side, and when it is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import SIDES, Side, mirror_of
from handpose.estimate.estimator import SearchRegion
from handpose.estimate.hand import Hand
from handpose.fit.body import WorldPose
from handpose.fit.pose_confidence import side_chance, side_evidence
from handpose.tracking.pose_estimator import PoseEstimator
from handpose.tracking.reasons import NO_HAND
from handpose.tracking.sizing import SizeKeeper
from handpose.tracking.smoothing import PoseFilter, turn_between, turned
from netlib.blob import Array

ENOUGH = 0.3  # minimum confidence of a hand
SURE = 0.985  # confidence below which a full fit is run
PAUSE, MAX_PAUSE = 0.25, 1.0  # s between full fits; doubled after each without improvement
SOON = 0.06  # s between full fits after an alarm, or if the side is uncertain
CONTRADICTED = 2  # number of joints in empty space from which a full fit is run; others were not measured
TROUBLE, ALARM = 1.4, 2.0  # selection cost relative to its average: run the network; run a full fit
# Expected error of fast fits, which follow a hand, relative to the accurate one that finds it: 9.8 and 7.7 mm on 8,192
# synthetic frames with earlier weights, 9.5 and 7.9 mm with the present ones.
FIRST = 1.3
HABIT = 0.1  # weight of the last frame in the average selection cost
BETTER = 0.9  # ratio of selection costs that counts as an improvement
ASK = 0.2  # s between runs of the network, whose pose competes with the tracked one
COAST = 0.4  # s without a pose after which a hand is lost
MAX_COVERED_S = 2.0  # s after which a covered one is lost
# s after which a hand whose reported confidence is below ENOUGH is given up. Of six real recordings of one hand the
# longest such time of the hand is 0.6 s, and that of other objects 4.4 s.
UNTRUSTED_S = 1.0
KEPT = 0.7  # damping of the expected motion
NEW = 0.6  # weight of the last two frames in the velocity
MAX_JUMP_MM = 130.0  # 4 m/s at 30 frames per second: a pose that is found farther away is no motion of the hand
COMPARE = 0.1  # s between comparisons of the sides, until the side is decided
# The side is decided by the mean log-ratio of the costs of the fits as either side. On real recordings a single ratio
# has the right sign in 64% to 100% of the frames, and the mean of the first second always.
MIN_COMPARED_S, MAX_COMPARED_S, MIN_COMPARED = 1.0, 3.0, 6  # s of comparisons: at least, at most; minimum number
CLEAR = 0.1  # mean ratio that decides before the maximum
MAX_SIDE_CONFIDENCE = 0.99  # of a side that is not decided
# The same without the surroundings: in a recording of a person at a table 68% of the decided sides were right, with
# mean ratios up to 0.4, so these sides are not decided.
MAX_SIDE_CONFIDENCE_ALONE = 0.68
REVISED, SETTLED = 2.0, 4.0  # sum of ratios that changes a decided side; maximum for that side, which delays a change


class Motion(NamedTuple):
    """The velocity of a body: mm/s, rad/s about the world's axes, and its other variables per second."""

    place: Array
    turn: Array
    others: Array


def motion_between(first: WorldPose, second: WorldPose, seconds: float) -> Motion:
    """The motion from one body to the other in this time."""
    return Motion(
        (second.place - first.place) / seconds,
        turn_between(first.rotation, second.rotation) / seconds,
        (second.others - first.others) / seconds,
    )


def moved(body: WorldPose, motion: Motion, seconds: float) -> WorldPose:
    """The body after this time."""
    return WorldPose(
        body.place + motion.place * seconds,
        turned(body.rotation, motion.turn * seconds),
        body.others + motion.others * seconds,
    )


class SideState:
    """The state of a hand as one side: its last pose, its motion, and its filter."""

    def __init__(self, estimate: Hand, time: float) -> None:
        self.estimate, self.time = estimate, time
        self.motion: Motion | None = None
        self.filter = PoseFilter()
        self.smooth = self.filter(estimate.body, time, estimate.error_mm)

    def expected(self, time: float) -> WorldPose:
        """The expected body at a time."""
        if self.motion is None:
            return self.estimate.body
        return moved(self.estimate.body, self.motion, KEPT * min(time - self.time, COAST))

    def take(self, estimate: Hand, time: float) -> None:
        """Add a pose.

        A pose whose fit did not start from the expected one changes only the velocity of the place, to that of the
        mean of the joints; and nothing if it is too far away.
        """
        seconds, way = time - self.time, _mean_joint(estimate) - _mean_joint(self.estimate)
        if estimate.is_tracked:
            self._add_motion(motion_between(self.estimate.body, estimate.body, seconds))
        elif np.linalg.norm(way) <= MAX_JUMP_MM:
            still = Motion(np.zeros(3), np.zeros(3), np.zeros_like(estimate.body.others))
            self._add_motion((self.motion or still)._replace(place=way / seconds))
        self.estimate, self.time = estimate, time
        self.smooth = self.filter(estimate.body, time, estimate.error_mm)

    def _add_motion(self, new: Motion) -> None:
        self.motion = Motion(*(NEW * n + (1 - NEW) * o for n, o in zip(new, self.motion or new)))


class HandTrack:
    """One hand of a recording: its state while it is tracked, and what is kept while it is lost.

    id          of the hand; -1 until it has one
    is_tracked  False while it is lost
    sides       state for each side; both until the side is decided
    time        s, of its last pose
    covered     True if another object covered it in the last frame, or nothing was read of it
    rejections  number of consecutive checks that rejected it
    checked     s, time of the last check
    size        relative to the skeleton, once it is known
    sizes       estimates the size
    likely      assumed size until then, or None
    decided     the side that was decided last, or None
    place       (3,) mm, where it was seen last as a hand whose side was decided, or None
    since       s, when it was reported last
    trusted     s, of its last reported pose with enough confidence
    reason      why it was lost
    alone       True if its surroundings are removed from its crops
    usual_cost  the average selection cost of its poses
    """

    def __init__(
        self,
        estimator: PoseEstimator,
        estimates: Sequence[Hand],
        time: float,
        size: float | None = None,
        side_prior: float = 0.0,
        alone: bool = False,
    ) -> None:
        """``side_prior``: prior evidence for a right hand (above 0) or a left one."""
        self.id, self.is_tracked, self.alone = -1, True, alone
        self.time = self.since = self.trusted = time
        self.size, self.sizes = size, SizeKeeper(estimator)
        self.likely: float | None = None
        self.decided: Side | None = None
        self.place: Array | None = None
        self.reason = ""
        self.covered, self.rejections, self.checked = False, 0, time
        self._estimator = estimator
        self.sides = {estimate.hand: SideState(estimate, time) for estimate in estimates}
        self._asked = self._looked = time
        self._pause, self._missed = PAUSE, False
        self.usual_cost = FIRST * min(estimate.selection_cost for estimate in estimates)
        self._evidence, self._compared, self._begun = side_prior, 0, time
        self._compare(_best(estimates), time)
        self._keep_side()

    def identify(self, id: int, before: HandTrack | None = None) -> None:
        """Give the hand its id; if it is one that was lost, with what is known of it."""
        self.id = id
        if before is not None:
            self.size, self.sizes, self.place = before.size, before.sizes, before.place
            self.decided = self.decided or before.decided

    def end(self, reason: str = "") -> None:
        """Stop tracking the hand; without a reason, that of the last frame in which it was not found."""
        self.is_tracked, self.reason = False, reason or self.reason

    @property
    def hand(self) -> Side:
        """The more likely side."""
        if self.is_decided:
            return next(iter(self.sides))
        return "right" if self._evidence >= 0 else "left"

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
        mean = abs(self._evidence) / max(self._compared, MIN_COMPARED)
        return min(side_chance(mean), MAX_SIDE_CONFIDENCE_ALONE if self.alone else MAX_SIDE_CONFIDENCE)

    @property
    def is_sure(self) -> bool:
        """True if the side is decided and the confidence is high."""
        return self.is_decided and self.best.estimate.chance >= SURE

    def regions(self, time: float) -> list[SearchRegion]:
        """The search regions in a frame; with and without the network, whose last use is recorded."""
        troubled = self._missed or self.best.estimate.selection_cost > TROUBLE * self.usual_cost
        asked = troubled or not self.is_decided or time - self._asked >= ASK
        self._asked = time if asked else self._asked
        regions = []
        for side, seen in self.sides.items():
            region = self._region(side, seen.expected(time))
            regions.append(region if asked else replace(region, moved_mm=seen.estimate.moved_mm))
        return regions

    def other_regions(self, depth: NDArray[np.float32], estimates: Sequence[Hand], time: float) -> list[SearchRegion]:
        """Further search regions for a full fit, if the pose or the side is uncertain, or the image contradicts it.

        These are the last pose, and the hand found by the locator, or else the palm predicted by the network, there as
        either side: a side decided in bad conditions may be wrong.
        """
        sure = max((estimate.chance for estimate in estimates), default=0.0)
        best = min(estimates, key=lambda estimate: estimate.selection_cost, default=None)
        alarmed = best is None or best.selection_cost > ALARM * self.usual_cost or best.in_empty_space >= CONTRADICTED
        pause = COMPARE if not self.is_decided else SOON if alarmed else self._pause
        if (self.is_decided and sure >= SURE and not alarmed) or time - self._looked < pause:
            return []
        self._looked = time
        regions = []
        for estimate in estimates:
            side, center = estimate.hand, self._estimator.hand_near(depth, estimate)
            regions.append(SearchRegion(center, side, self.sides[side].estimate.body, self._size, alone=self.alone))
            if self.is_decided:
                others = (other for other in self._estimator.sides if other != side)
                regions += [SearchRegion(center, other, None, self._size, alone=self.alone) for other in others]
        return regions or [self._region(side, seen.estimate.body) for side, seen in self.sides.items()]

    def take(self, estimates: Sequence[Hand], others: Sequence[Hand], time: float) -> bool:
        """Add the poses found in its regions and in others, the best for each side; True if one is good enough."""
        first, second = _best(estimates), _best(others)
        if self.is_decided:
            self._reconsider(second)
        before = min((estimate.selection_cost for estimate in first.values()), default=np.inf)
        best = _best([*first.values(), *second.values()])
        self._compare(best, time)
        own = [best[side] for side in self.sides if side in best]
        if second and self.is_decided:
            # The accurate plan expects smaller errors of the same pose, so only another pose can be a better one.
            better = any(not estimate.is_tracked and estimate.selection_cost < BETTER * before for estimate in own)
            doubted = self._evidence > 0  # it may be a hand of the other side
            self._pause = SOON if doubted else PAUSE if better else min(2 * self._pause, MAX_PAUSE)
        self._missed = not own or max(estimate.chance for estimate in own) < ENOUGH
        if self._missed:
            return False
        for estimate in own:
            self.sides[estimate.hand].take(estimate, time)
        self.time = time
        self._keep_side()
        self.usual_cost += HABIT * (self.best.estimate.selection_cost - self.usual_cost)
        if self.is_sure:
            self._pause = PAUSE
        return True

    def trust(self, confidence: float, time: float) -> None:
        """Take the confidence of the pose that is reported, as a hand of its side, judged with its surroundings."""
        if not confidence < ENOUGH:  # or not known
            self.trusted = time
        else:
            self.reason = f"{NO_HAND} (confidence {confidence:.0%}{' among its surroundings' if self.alone else ''})"

    @property
    def is_untrusted(self) -> bool:
        """True if its poses were not trusted for too long."""
        return self.time - self.trusted > (COAST if self.alone else UNTRUSTED_S)

    def given_up(self, time: float) -> bool:
        """True if it was lost, or its poses were not trusted, for too long."""
        return self.is_untrusted or time - self.time > (MAX_COVERED_S if self.covered else COAST)

    def _keep_side(self) -> None:
        if self.is_decided:
            self.decided = self.hand

    def _region(self, side: Side, body: WorldPose) -> SearchRegion:
        return SearchRegion(self._estimator.center_of(body, side), side, body, self._size, alone=self.alone)

    @property
    def _size(self) -> float | None:
        return self.likely if self.size is None else self.size

    def _compare(self, best: dict[Side, Hand], time: float) -> None:
        """Add the evidence of a frame while the side is undecided, and decide it."""
        ratio = _evidence_of(best)
        if self.is_decided or ratio is None:
            return
        self._evidence += ratio
        self._compared += 1
        seconds, mean = time - self._begun, abs(self._evidence) / self._compared
        enough = seconds >= MIN_COMPARED_S and self._compared >= MIN_COMPARED
        clear = mean > CLEAR or seconds >= MAX_COMPARED_S
        if enough and clear and not self.alone and self.hand in self.sides:
            self.sides = {self.hand: self.best}
            self._evidence = 0.0

    def _reconsider(self, best: dict[Side, Hand]) -> None:
        """Sum up the evidence for the other side, less that for this one."""
        ratio = _evidence_of(best)
        if ratio is None:
            return
        against = -ratio if self.hand == "right" else ratio
        self._evidence = max(self._evidence + against, -SETTLED)
        if self._evidence > REVISED:
            self.sides = {side: SideState(estimate, self.time) for side, estimate in best.items() if side != self.hand}
            self._evidence = 0.0


def _mean_joint(estimate: Hand) -> Array:
    """The mean (3,) of the joints in mm, in the axes of the fit."""
    return np.asarray(estimate.xyz.mean(axis=0) * mirror_of(estimate.hand))


def _best(estimates: Sequence[Hand]) -> dict[Side, Hand]:
    """The best pose of each side."""
    best: dict[Side, Hand] = {}
    for estimate in estimates:
        if estimate.hand not in best or estimate.selection_cost < best[estimate.hand].selection_cost:
            best[estimate.hand] = estimate
    return best


def _evidence_of(best: dict[Side, Hand]) -> float | None:
    """The evidence of one frame for a right hand; None without a visible hand of either side."""
    if len(best) < 2 or max(estimate.chance for estimate in best.values()) < ENOUGH:
        return None
    right, left = (best[side].cost if np.isfinite(best[side].uncertainty) else np.inf for side in SIDES)
    return side_evidence(right, left)
