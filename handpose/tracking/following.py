"""One hand followed from frame to frame: where to look next, which hand it is, when it is lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handpose.tracking.body_pose import Motion, Placed, motion_between, moved
from handpose.tracking.looking import Aim, Looker, Sight
from handpose.tracking.smoothing import PoseFilter

ENOUGH = 0.4  # confidence: less is no hand
SURE = 0.95  # with less, the hand is looked for anew, from where it was and from where the network sees it ...
ANEW = 0.25  # s ... so often at most
ASK = 0.2  # s between frames in which the network's pose competes with the one that is followed
COAST = 0.4  # s that a hand is looked for where it was before it is given up
KEPT = 0.7  # of the speed, from frame to frame
NEW = 0.6  # how much of a speed is that of the last two frames
DECIDED = 4.0  # logarithm of the ratio of doubts, summed up, that decides between left and right
MOST = 1.0  # of it that one frame may say
LONG = 20  # frames after which more of them decide


class Seen:
    """A hand seen as one side: its last pose, how it moves, and its filter."""

    def __init__(self, sight: Sight, time: float) -> None:
        self.sight, self.time = sight, time
        self.motion: Motion | None = None
        self.filter = PoseFilter()
        self.smooth = self.filter(sight.body, time)

    def expected(self, time: float) -> Placed:
        """The body at a time, as it moved."""
        if self.motion is None:
            return self.sight.body
        return moved(self.sight.body, self.motion, KEPT * (time - self.time))

    def take(self, sight: Sight, time: float) -> None:
        """What was seen next."""
        new = motion_between(self.sight.body, sight.body, time - self.time)
        old = self.motion or new
        self.motion = Motion(*(NEW * n + (1 - NEW) * o for n, o in zip(new, old)))
        self.sight, self.time = sight, time
        self.smooth = self.filter(sight.body, time)


class Follower:
    """A hand that is followed.

    id       of the hand
    sides    seen as which hand it is followed: both until it is decided
    time     s, when it was seen last
    strikes  how often in a row what is followed did not look like a hand
    checked  s, when that was looked at last
    size     relative to the skeleton, once it is known
    """

    def __init__(self, id: int, looker: Looker, sights: Sequence[Sight], time: float, size: float | None) -> None:
        self.id, self.time, self.size = id, time, size
        self.strikes, self.checked = 0, time
        self._looker = looker
        self.sides = {sight.aim.side: Seen(sight, time) for sight in sights}
        self._anew = self._asked = time
        self._evidence, self._frames = 0.0, 0
        self._weigh(sights)

    @property
    def best(self) -> Seen:
        """The side that it most likely is."""
        if len(self.sides) == 1:
            return next(iter(self.sides.values()))
        return self.sides["right" if self._evidence >= 0 else "left"]

    @property
    def is_decided(self) -> bool:
        """Is it known which hand it is?"""
        return len(self.sides) == 1

    @property
    def is_sure(self) -> bool:
        """Was it seen well, and is it known which hand it is?"""
        return self.is_decided and self.best.sight.confidence >= SURE

    def aims(self, time: float) -> list[Aim]:
        """Where to look for it in a frame; while it is sure, the network is asked only now and then."""
        asked = not self.is_sure or time - self._asked >= ASK
        self._asked = time if asked else self._asked
        aims = [self._aim(side, seen.expected(time)) for side, seen in self.sides.items()]
        return aims if asked else [aim._replace(moved_mm=self._moved(aim.side)) for aim in aims]

    def other_aims(self, sights: Sequence[Sight | None], time: float) -> list[Aim]:
        """Where else, if what was seen is not sure: where it was, and where the network sees a palm near."""
        sure = max((sight.confidence for sight in sights if sight is not None), default=0.0)
        if sure >= SURE or time - self._anew < ANEW:
            return []
        self._anew = time
        aims = [self._aim(side, seen.sight.body) for side, seen in self.sides.items()]
        for sight in sights:
            if sight is not None:
                center = self._looker.palm_seen(sight)
                aims.append(Aim(center, sight.aim.side, self.sides[sight.aim.side].sight.body, self.size))
        return aims

    def take(self, sights: Sequence[Sight | None], time: float) -> bool:
        """What was seen of it; is it the hand? Of each side the best of several sights counts."""
        best: dict[str, Sight] = {}
        for sight in sights:
            if sight is not None and (sight.aim.side not in best or sight.badness < best[sight.aim.side].badness):
                best[sight.aim.side] = sight
        if not best or max(sight.confidence for sight in best.values()) < ENOUGH:
            return False
        for side, sight in best.items():
            self.sides[side].take(sight, time)
        self.time = time
        self._weigh(sights[: len(self.sides)])
        return True

    def _moved(self, side: str) -> float:
        """How far the last fit is said to be from the network's joints, mm."""
        return float(self.sides[side].sight.fit.signs[0, -1])

    def given_up(self, time: float) -> bool:
        """Was it lost for too long?"""
        return time - self.time > COAST

    def _aim(self, side: str, body: Placed) -> Aim:
        return Aim(self._looker.center_of(body, side), side, body, self.size)

    def _weigh(self, sights: Sequence[Sight | None]) -> None:
        """Left or right, by one look at both: decided by the sum of what the frames say, and then kept."""
        doubt = {sight.aim.side: sight.doubt for sight in sights if sight is not None}
        if len(doubt) < 2 or self.is_decided:
            return
        says = np.log(max(doubt["left"], 1e-9)) - np.log(max(doubt["right"], 1e-9))
        self._evidence += float(np.clip(np.nan_to_num(says), -MOST, MOST))
        self._frames += 1
        if abs(self._evidence) > DECIDED or self._frames >= LONG:
            side = "right" if self._evidence >= 0 else "left"
            self.sides = {side: self.sides[side]}
