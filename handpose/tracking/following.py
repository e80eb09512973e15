"""One hand followed from frame to frame: where to look next, which hand it is, when it is lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.facts.sides import SIDES, Side
from handpose.tracking.body_pose import Motion, Placed, motion_between, moved
from handpose.tracking.looking import Aim, Looker, Sight
from handpose.tracking.smoothing import PoseFilter

ENOUGH = 0.3  # confidence: less is no hand
SURE = 0.985  # with less, the hand is looked at anew, with all that a fit can try ...
PAUSE, LONGEST_PAUSE = 0.25, 1.0  # ... s apart at least, and twice as long whenever that found nothing better, ...
SOON = 0.06  # ... unless the hand is in trouble, or may be the other one: then s apart
TROUBLE, ALARM = 1.4, 2.0  # badness, relative to the usual one of this hand: the network is asked; looked at anew
HABIT = 0.1  # how much of the usual badness is that of the last frame
BETTER = 0.9  # of the badness: so much is better
ASK = 0.2  # s between frames in which the network's pose competes with the one that is followed
COAST = 0.4  # s that a hand is looked for where it was before it is given up
KEPT = 0.7  # of the speed, from frame to frame
NEW = 0.6  # how much of a speed is that of the last two frames
COMPARE = 0.1  # s between looks that compare left and right, until it is decided
DECIDED = 3.0  # logarithm of the ratio of doubts, summed up over such looks, that decides between left and right
MAX_EVIDENCE = 1.2  # of it that one look may say
SETTLED = 6.0  # the most that later looks may say for the side that was decided: so much longer it stays
LOOKS = 6  # after so many the sum decides, whatever it is


class Seen:
    """A hand seen as one side: its last pose, how it moves, and its filter."""

    def __init__(self, sight: Sight, time: float) -> None:
        self.sight, self.time = sight, time
        self.motion: Motion | None = None
        self.filter = PoseFilter()
        self.smooth = self.filter(sight.body, time, sight.error_mm)

    def expected(self, time: float) -> Placed:
        """The body at a time, as it moved."""
        if self.motion is None:
            return self.sight.body
        return moved(self.sight.body, self.motion, KEPT * (time - self.time))

    def take(self, sight: Sight, time: float) -> None:
        """What was seen next. A jump to another pose is no movement: then the hand is taken to move on as before."""
        if sight.goes_on:
            new = motion_between(self.sight.body, sight.body, time - self.time)
            old = self.motion or new
            self.motion = Motion(*(NEW * n + (1 - NEW) * o for n, o in zip(new, old)))
        self.sight, self.time = sight, time
        self.smooth = self.filter(sight.body, time, sight.error_mm)


class Follower:
    """A hand that is followed.

    id       of the hand
    sides    seen as which hand it is followed: both until it is decided
    time     s, when it was seen last
    strikes  how often in a row what is followed did not look like a hand
    checked  s, when that was looked at last
    size     relative to the skeleton, once it is known
    likely   what it likely is until then, if there is reason to think so
    """

    def __init__(
        self, id: int, looker: Looker, sights: Sequence[Sight], time: float, size: float | None, leaning: float = 0.0
    ) -> None:
        """``leaning``: what speaks for a right hand (above 0) or a left one beside its picture."""
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
        """Which hand it most likely is."""
        if self.is_decided:
            return next(iter(self.sides))
        return "right" if self._evidence >= 0 else "left"

    @property
    def best(self) -> Seen:
        """That side."""
        return self.sides[self.hand]

    @property
    def is_decided(self) -> bool:
        """Is it known which hand it is?"""
        return len(self.sides) == 1

    @property
    def is_sure(self) -> bool:
        """Was it seen well, and is it known which hand it is?"""
        return self.is_decided and self.best.sight.confidence >= SURE

    def aims(self, time: float) -> list[Aim]:
        """Where to look for it in a frame; while all is well, the network is asked at intervals, which is noted."""
        troubled = self._missed or self.best.sight.badness > TROUBLE * self._usual
        asked = troubled or not self.is_decided or time - self._asked >= ASK
        self._asked = time if asked else self._asked
        aims = [self._aim(side, seen.expected(time)) for side, seen in self.sides.items()]
        return aims if asked else [aim._replace(moved_mm=self._moved(aim.side)) for aim in aims]

    def other_aims(self, depth: NDArray[np.float32], sights: Sequence[Sight | None], time: float) -> list[Aim]:
        """Where else to look, with all that a fit can try, if what was seen is not sure, or not which hand it is.

        Where the locator sees a hand, or else the network a palm, with the pose that was seen last as a further start;
        there also as the other hand: who decided in bad light may be wrong. Where it was, if nothing was seen.
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
        """What was seen of it, and seen elsewhere; is it the hand? Of each side the best of several sights counts."""
        first, second = _best(sights), _best(others)
        if max((sight.confidence for sight in second.values()), default=0.0) >= ENOUGH:
            self._weigh(list(second.values()))
        before = min((sight.badness for sight in first.values()), default=np.inf)
        best = _best([*first.values(), *second.values()])
        own = [best[side] for side in self.sides if side in best]
        if second and self.is_decided:
            # The accurate plan expects smaller errors of the same pose, so only another pose can be a better one.
            better = any(not sight.goes_on and sight.badness < BETTER * before for sight in own)
            doubted = self._evidence > 0  # it may be the other hand
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
        """Was it lost for too long?"""
        return time - self.time > COAST

    def _aim(self, side: Side, body: Placed) -> Aim:
        return Aim(self._looker.center_of(body, side), side, body, self._size)

    @property
    def _size(self) -> float | None:
        return self.likely if self.size is None else self.size

    def _moved(self, side: Side) -> float:
        """How far the last fit is said to be from the network's joints, mm."""
        return float(self.sides[side].sight.fit.signs[0, -1])

    def _weigh(self, sights: Sequence[Sight]) -> None:
        """Left or right: decided by the sum of what looks at both say, and then kept, unless all that is seen later
        says the other."""
        doubt = {sight.aim.side: sight.doubt for sight in sights}
        known = np.array(list(doubt.values()))
        if len(doubt) < 2 or np.isnan(known).any() or np.isinf(known).all():  # where nothing is seen, nothing is said
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
        """Sum up what speaks for the other hand, less what speaks for this one."""
        side = self.hand
        against = -says if side == "right" else says
        self._evidence = max(self._evidence + against, -SETTLED)
        if self._evidence > DECIDED:
            self.sides = {sight.aim.side: Seen(sight, self.time) for sight in sights if sight.aim.side != side}
            self._evidence = 0.0


def _best(sights: Sequence[Sight | None]) -> dict[Side, Sight]:
    """The best of each side."""
    best: dict[Side, Sight] = {}
    for sight in sights:
        if sight is not None and (sight.aim.side not in best or sight.badness < best[sight.aim.side].badness):
            best[sight.aim.side] = sight
    return best
