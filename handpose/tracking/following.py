"""The state of one tracked hand: its next search regions, its side, and when it is lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.facts.sides import SIDES, Side
from handpose.tracking.body_pose import Motion, Placed, motion_between, moved
from handpose.tracking.looking import Aim, Looker, Sight
from handpose.tracking.smoothing import PoseFilter

ENOUGH = 0.3  # minimum confidence of a hand
SURE = 0.985  # confidence below which a full fit is run
PAUSE, LONGEST_PAUSE = 0.25, 1.0  # s between full fits; doubled after each without improvement
SOON = 0.06  # s between full fits after an alarm, or if the side is uncertain
TROUBLE, ALARM = 1.4, 2.0  # badness relative to its average: run the network; run a full fit
HABIT = 0.1  # weight of the last frame in the average badness
BETTER = 0.9  # ratio of badness that counts as an improvement
ASK = 0.2  # s between runs of the network, whose pose competes with the tracked one
COAST = 0.4  # s without a pose after which a hand is lost
KEPT = 0.7  # damping of the expected motion
NEW = 0.6  # weight of the last two frames in the velocity
COMPARE = 0.1  # s between comparisons of the sides, until the side is decided
DECIDED = 3.0  # sum of the log-ratios of uncertainties that decides the side
MAX_EVIDENCE = 1.2  # maximum contribution of one comparison
SETTLED = 6.0  # maximum evidence for the decided side, which delays a revision
LOOKS = 6  # number of comparisons after which the sign of the sum decides


class Seen:
    """The state of a hand as one side: its last pose, its motion, and its filter."""

    def __init__(self, sight: Sight, time: float) -> None:
        self.sight, self.time = sight, time
        self.motion: Motion | None = None
        self.filter = PoseFilter()
        self.smooth = self.filter(sight.body, time, sight.error_mm)

    def expected(self, time: float) -> Placed:
        """The expected body at a time."""
        if self.motion is None:
            return self.sight.body
        return moved(self.sight.body, self.motion, KEPT * (time - self.time))

    def take(self, sight: Sight, time: float) -> None:
        """Add a pose. A jump to another pose does not change the motion."""
        if sight.goes_on:
            new = motion_between(self.sight.body, sight.body, time - self.time)
            old = self.motion or new
            self.motion = Motion(*(NEW * n + (1 - NEW) * o for n, o in zip(new, old)))
        self.sight, self.time = sight, time
        self.smooth = self.filter(sight.body, time, sight.error_mm)


class Follower:
    """A tracked hand.

    id       of the hand
    sides    state for each side; both until the side is decided
    time     s, of its last pose
    strikes  number of consecutive checks that rejected it
    checked  s, time of the last check
    size     relative to the skeleton, once it is known
    likely   assumed size until then, or None
    """

    def __init__(
        self, id: int, looker: Looker, sights: Sequence[Sight], time: float, size: float | None, leaning: float = 0.0
    ) -> None:
        """``leaning``: prior evidence for a right hand (above 0) or a left one."""
        self.id, self.time, self.size = id, time, size
        self.likely: float | None = None
        self.strikes, self.checked = 0, time
        self._looker = looker
        self.sides = {sight.aim.side: Seen(sight, time) for sight in sights}
        self._asked = self._looked = time
        self._pause, self._missed = PAUSE, False
        self._usual = min(sight.badness for sight in sights)
        self._evidence, self._looks = leaning, 0
        self._weigh(sights)

    @property
    def hand(self) -> Side:
        """The likelier side."""
        if self.is_decided:
            return next(iter(self.sides))
        return "right" if self._evidence >= 0 else "left"

    @property
    def best(self) -> Seen:
        """The state of the likelier side."""
        return self.sides[self.hand]

    @property
    def is_decided(self) -> bool:
        """True if the side is decided."""
        return len(self.sides) == 1

    @property
    def is_sure(self) -> bool:
        """True if the side is decided and the confidence is high."""
        return self.is_decided and self.best.sight.confidence >= SURE

    def aims(self, time: float) -> list[Aim]:
        """The search regions in a frame; with and without the network, whose last use is recorded."""
        troubled = self._missed or self.best.sight.badness > TROUBLE * self._usual
        asked = troubled or not self.is_decided or time - self._asked >= ASK
        self._asked = time if asked else self._asked
        aims = [self._aim(side, seen.expected(time)) for side, seen in self.sides.items()]
        return aims if asked else [aim._replace(moved_mm=self._moved(aim.side)) for aim in aims]

    def other_aims(self, depth: NDArray[np.float32], sights: Sequence[Sight | None], time: float) -> list[Aim]:
        """Further search regions for a full fit, if the pose or the side is uncertain.

        These are the last pose, and the hand found by the locator, or else the palm predicted by the network, there as
        either side: a side decided in bad conditions may be wrong.
        """
        sure = max((sight.confidence for sight in sights if sight is not None), default=0.0)
        alarmed = min((sight.badness for sight in sights if sight is not None), default=np.inf) > ALARM * self._usual
        pause = COMPARE if not self.is_decided else SOON if alarmed else self._pause
        if (self.is_decided and sure >= SURE and not alarmed) or time - self._looked < pause:
            return []
        self._looked = time
        aims = []
        for side, sight in ((sight.aim.side, sight) for sight in sights if sight is not None):
            center = self._looker.hand_near(depth, sight)
            aims.append(Aim(center, side, self.sides[side].sight.body, self._size))
            if self.is_decided:
                others = (other for other in self._looker.sides if other != side)
                aims += [Aim(center, other, None, self._size) for other in others]
        return aims or [self._aim(side, seen.sight.body) for side, seen in self.sides.items()]

    def take(self, sights: Sequence[Sight | None], others: Sequence[Sight | None], time: float) -> bool:
        """Add the poses found in its regions and in others, the best for each side; True if it is still the hand."""
        first, second = _best(sights), _best(others)
        if max((sight.confidence for sight in second.values()), default=0.0) >= ENOUGH:
            self._weigh(list(second.values()))
        before = min((sight.badness for sight in first.values()), default=np.inf)
        best = _best([*first.values(), *second.values()])
        own = [best[side] for side in self.sides if side in best]
        if second and self.is_decided:
            # The accurate plan expects smaller errors of the same pose, so only another pose can be a better one.
            better = any(not sight.goes_on and sight.badness < BETTER * before for sight in own)
            doubted = self._evidence > 0  # it may be a hand of the other side
            self._pause = SOON if doubted else PAUSE if better else min(2 * self._pause, LONGEST_PAUSE)
        self._missed = not own or max(sight.confidence for sight in own) < ENOUGH
        if self._missed:
            return False
        for sight in own:
            self.sides[sight.aim.side].take(sight, time)
        self.time = time
        self._usual += HABIT * (self.best.sight.badness - self._usual)
        if self.is_sure:
            self._pause = PAUSE
        return True

    def given_up(self, time: float) -> bool:
        """True if it was lost for too long."""
        return time - self.time > COAST

    def _aim(self, side: Side, body: Placed) -> Aim:
        return Aim(self._looker.center_of(body, side), side, body, self._size)

    @property
    def _size(self) -> float | None:
        return self.likely if self.size is None else self.size

    def _moved(self, side: Side) -> float:
        """The distance of the last fit from the network's joints, mm."""
        return float(self.sides[side].sight.fit.signs[0, -1])

    def _weigh(self, sights: Sequence[Sight]) -> None:
        """Update the evidence for the side: its sum decides, and later evidence for the other side can revise it."""
        doubt = {sight.aim.side: sight.doubt for sight in sights}
        known = np.array(list(doubt.values()))
        if len(doubt) < 2 or np.isnan(known).any() or np.isinf(known).all():  # no evidence without a visible hand
            return
        right, left = (np.log(np.clip(doubt[side], 1e-9, 1e9)) for side in SIDES)
        says = float(np.clip(left - right, -MAX_EVIDENCE, MAX_EVIDENCE))
        if self.is_decided:
            self._reconsider(says, sights)
            return
        self._evidence += says
        self._looks += 1
        if abs(self._evidence) > DECIDED or self._looks >= LOOKS:
            self.sides = {self.hand: self.best}
            self._evidence = 0.0

    def _reconsider(self, says: float, sights: Sequence[Sight]) -> None:
        """Sum up the evidence for the other side, less that for this one."""
        side = self.hand
        against = -says if side == "right" else says
        self._evidence = max(self._evidence + against, -SETTLED)
        if self._evidence > DECIDED:
            self.sides = {sight.aim.side: Seen(sight, self.time) for sight in sights if sight.aim.side != side}
            self._evidence = 0.0


def _best(sights: Sequence[Sight | None]) -> dict[Side, Sight]:
    """The best pose of each side."""
    best: dict[Side, Sight] = {}
    for sight in sights:
        if sight is not None and (sight.aim.side not in best or sight.badness < best[sight.aim.side].badness):
            best[sight.aim.side] = sight
    return best
