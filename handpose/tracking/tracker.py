"""Tracker: the hands in a depth recording, frame by frame.

with open_recording("frames") as recording:
    tracker = load_tracker(recording.camera)
    for frame in tracker.follow(recording):
        print(frame.time, [hand.xyz for hand in frame.hands], [hand.reason for hand in frame.lost])

A hand is expected where its motion leads; the fit starts from that pose, at intervals also from the network's
prediction, and the better one is used. While there are fewer hands than allowed, the image is searched for more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import check_size
from handpose.data.depth_images import check_unit, depth_image
from handpose.depth_fit.search import ACCURATE, FAST, Fit, Plan
from handpose.facts.cameras import Camera
from handpose.facts.sides import Side, mirror_of
from handpose.prediction.nets import refuse_other_bodies
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor, check_whole
from handpose.sources.recording import DepthFrame
from handpose.track_files.track import LostHand, TrackedFrame, TrackHeader
from handpose.tracking.following import COAST, ENOUGH, Follower
from handpose.tracking.looking import LIKELY, Aim, Looker, Sight
from handpose.tracking.reasons import NO_HAND, reason
from handpose.tracking.scouting import NOWHERE, Scout
from handpose.tracking.sizing import SizeKeeper, checked
from handpose.tracking.telling import told
from netlib.blob import Array
from netlib.errors import DataError, NetlibError

MAX_HANDS = 100  # larger numbers of hands are invalid
SAME_MM = 70.0  # palms closer together are the same hand
# Limits of the rejection score of new and of tracked hands. Of 190 hands in synthetic scenes with
# three cameras 95% are below 109 mm, 99% below 127 mm.
STRANGE_NEW_MM, STRANGE_MM = 110.0, 135.0
CHECK, SUSPECT = 0.2, 0.08  # s between checks of certain and of uncertain hands
RETURN, RETURN_MM = 2.0, 300.0  # s and mm within which a new hand is a lost one
STRIKES = 2  # number of consecutive rejections that end a track


def load_tracker(camera: Camera, *, fit: Fit = "fast", **options: object) -> Tracker:
    """A tracker with the packaged weights; for the options see ``Tracker``. Raises NetlibError."""
    return Tracker(load_predictor(camera, fit=fit), **options)  # type: ignore[arg-type]


@dataclasses.dataclass
class Known:
    """The state of a hand that is kept even while it is lost."""

    hand: Side
    since: float
    reason: str
    sizes: SizeKeeper
    size: float | None
    place: Array | None = None  # (3,) mm, where it was seen last as a hand whose side was decided


class Tracker:
    """Tracks hands.

    predictor  with a locator, a fit, and a camera of the frames' size
    hands      maximum number at a time
    smooth     smooth poses over time
    size       of all hands, relative to the skeleton; by default each is estimated from its first seconds
    flesh      output each hand's surface, too

    Raises NetlibError for an unsuitable predictor or number of hands, DataError for a size that cannot be fitted.
    """

    def __init__(
        self, predictor: Predictor, *, hands: int = 2, smooth: bool = True, size: float | None = None,
        flesh: bool = False,
    ) -> None:  # fmt: skip
        if predictor.fitter is None or predictor.locator is None:
            raise NetlibError("a tracker needs a predictor with a fit and a locator")
        check_whole("hands", hands, 1, MAX_HANDS)
        refuse_other_bodies(predictor.skeleton, "only hands are followed")
        self.predictor, self.camera = predictor, predictor.camera
        self.limit, self.smooth, self.flesh = hands, smooth, flesh
        self.size = None if size is None else checked(size)
        self.looker = Looker(predictor, self.camera)
        self.scout = Scout(predictor.locator, self.camera)
        self.followers: list[Follower] = []
        self.known: dict[int, Known] = {}
        self._time = -np.inf
        self._read = False  # was anything, in any frame?

    def header(self, source: str) -> TrackHeader:
        """The header of the track."""
        return TrackHeader(source, self.camera, self.predictor.skeleton, self.predictor.cube_mm / 2, self.smooth)

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[TrackedFrame]:
        """The hands of all frames, in the order of their times. Raises DataError, NetlibError."""
        for frame in frames:
            yield self.step(frame)

    def step(self, frame: DepthFrame) -> TrackedFrame:
        """The hands of the next frame. Raises DataError for another size, or a time that is not later; NetlibError.

        Raises UnitError for the first frame with readings if these are in metres or negative.
        """
        depth, time = np.asarray(depth_image(frame.depth), dtype=np.float32), frame.time
        check_size(depth, self.camera)
        if not self._read:
            check_unit(depth, np.inf)
            self._read = bool((depth > 0).any())
        if not time > self._time:
            raise DataError(f"frame {frame.number} is of {time:g} s, after one of {self._time:g} s; times must ascend")
        self._follow(depth, time)
        anew, self._time = time - self._time > COAST, time
        self._drop_doubles()
        self._drop_strange(depth, time)
        while (count := len(self.followers)) < self.limit:
            self._scout(depth, time)
            self._drop_doubles()
            if not anew or len(self.followers) == count:
                break
            self.scout.begin_anew()  # after a gap in time, search for all hands at once
        hands = []
        for follower in sorted(self.followers, key=lambda one: one.id):
            if follower.time == time:
                self._measure(follower, time)
                self.known[follower.id].since = time
                if follower.is_decided:
                    self.known[follower.id].place = self._middle(follower)
                hands.append(told(follower, self.looker, smooth=self.smooth, flesh=self.flesh))
        lost = tuple(
            LostHand(id, known.hand, known.since, known.reason)
            for id, known in sorted(self.known.items())
            if all(id != hand.id for hand in hands)
        )
        return TrackedFrame(frame.number, time, tuple(hands), lost)

    def _follow(self, depth: NDArray[np.float32], time: float) -> None:
        """Find every hand where it is expected; after a gap in time it is dropped."""
        for follower in list(self.followers):
            if follower.given_up(time):
                self.followers.remove(follower)
                if time - self._time > COAST:
                    self.known[follower.id].reason = f"no frame for {time - self._time:.1f} s, and not found again"
        for follower in self.followers:
            follower.likely = self._size_beside(follower.id)
        aims = {follower.id: follower.aims(time) for follower in self.followers}
        sights = self._looks(depth, aims)
        others = {follower.id: follower.other_aims(depth, sights[follower.id], time) for follower in self.followers}
        again = self._looks(depth, others, ACCURATE)
        for follower in list(self.followers):
            known, seen = self.known[follower.id], [*sights[follower.id], *again[follower.id]]
            if follower.take(sights[follower.id], again[follower.id], time):
                known.hand = follower.best.sight.aim.side
                continue
            best = min((s for s in seen if s is not None), key=lambda s: s.badness, default=None)
            known.reason = reason(depth, self.camera, self.looker.cube_mm, aims[follower.id][0], best)

    def _looks(
        self, depth: NDArray[np.float32], aims: dict[int, list[Aim]], plan: Plan | None = None
    ) -> dict[int, list[Sight | None]]:
        """The poses in regions of several hands, by their ids."""
        sights = iter(self.looker.look(depth, [aim for own in aims.values() for aim in own], plan))
        return {id: [next(sights) for _ in own] for id, own in aims.items()}

    def _drop_doubles(self) -> None:
        """Drop one of two tracks of the same hand: the one lost earlier, otherwise the worse one."""
        for follower in sorted(self.followers, key=lambda one: (-one.time, one.best.sight.badness)):
            if follower not in self.followers:
                continue
            for other in list(self.followers):
                if other is not follower and np.linalg.norm(self._middle(follower) - self._middle(other)) < SAME_MM:
                    self.followers.remove(other)
                    self.known[other.id].reason = "another hand is followed in its place"

    def _drop_strange(self, depth: NDArray[np.float32], time: float) -> None:
        """Drop tracks of objects that are not hands, which network and fit may resemble."""
        for follower in list(self.followers):
            pause = CHECK if follower.is_sure else SUSPECT
            if follower.time < time or time - follower.checked < pause:
                continue
            follower.checked = time
            good = self._looks_like_a_hand(depth, follower.best.sight, STRANGE_MM)
            follower.strikes = 0 if good else follower.strikes + 1
            if follower.strikes >= STRIKES:
                self.followers.remove(follower)
                sight = follower.best.sight
                why = reason(depth, self.camera, self.looker.cube_mm, sight.aim, sight)
                self.known[follower.id].reason = NO_HAND if why.startswith(NO_HAND) else why

    def _looks_like_a_hand(self, depth: NDArray[np.float32], sight: Sight, strange_mm: float) -> bool:
        """True if the locator finds a hand and the rejection score is low enough."""
        if self.scout.chance(depth, sight.center_mm * mirror_of(sight.aim.side)) < LIKELY:
            return False
        return self.looker.rejection_score(sight) < strange_mm

    def _scout(self, depth: NDArray[np.float32], time: float) -> None:
        """Search for a hand that is not tracked."""
        middles = np.array([self._middle(follower) for follower in self.followers]).reshape(-1, 3)
        arms = [self.looker.arm(follower.best.sight) for follower in self.followers]
        place = self.scout.look(depth, middles, time, np.concatenate([*arms, NOWHERE]))
        if place is None:
            return
        seen = self._hands_at(depth, place)
        if not seen:
            self.scout.reject(place, time)
            return
        returned = self._just_lost(place, time)
        seen = [sight for sight in seen if sight.aim.side in returned] or seen
        follower = Follower(-1, self.looker, seen, time, self.size, self._leaning(time))
        follower.id = self._id_of(follower.hand, time)
        known = self.known.setdefault(follower.id, Known(follower.hand, time, "", SizeKeeper(self.looker), self.size))
        known.since, known.hand, follower.size = time, follower.hand, known.size
        self.followers = [other for other in self.followers if other.id != follower.id] + [follower]

    def _hands_at(self, depth: NDArray[np.float32], place: Array) -> list[Sight]:
        """The poses near a place (3,) in mm, as hands of each side; empty if it is not a hand.

        A fast prediction at the place itself comes first. It rejects 70% of the other objects before the slow search.
        """
        start = self.camera.project(place)
        if all(self.looker.rejection_score(sight) > STRANGE_MM for sight in self._sides_at(depth, start, FAST)):
            return []
        try:
            found = self.predictor.hands_at(depth, [start], [0.0])[0]
        except DataError:  # out of sight
            return []
        if found.fit is None or found.fit.rejection_score > STRANGE_MM:
            return []
        seen = self._sides_at(depth, found.center_uvd, ACCURATE)
        if not seen or max(s.confidence for s in seen) < ENOUGH:
            return []
        best = min(seen, key=lambda s: s.doubt)
        return seen if self._looks_like_a_hand(depth, best, STRANGE_NEW_MM) else []

    def _sides_at(self, depth: NDArray[np.float32], center_uvd: Array, plan: Plan) -> list[Sight]:
        """What is seen in a crop about a centre (3,), as a hand of each side; none if it is out of sight."""
        aims = [Aim(center_uvd, side) for side in self.predictor.sides]
        return [sight for sight in self.looker.look(depth, aims, plan) if sight is not None]

    def _missing(self, time: float) -> list[int]:
        """The ids of known hands that are not found in this frame."""
        seen = {follower.id for follower in self.followers if follower.time == time}
        return [id for id in self.known if id not in seen]

    def _just_lost(self, place: Array, time: float) -> set[Side]:
        """The sides of hands lost recently near a place (3,) in mm, because a hand does not change its side."""
        known = [self.known[id] for id in self._missing(time)]
        return {
            one.hand
            for one in known
            if one.place is not None and time - one.since < RETURN and np.linalg.norm(one.place - place) < RETURN_MM
        }

    def _leaning(self, time: float) -> float:
        """Prior evidence for a right hand (1) or a left one (-1): lost hands return."""
        sides = [self.known[id].hand for id in self._missing(time)]
        return float("right" in sides) - float("left" in sides)

    def _id_of(self, side: Side, time: float) -> int:
        """The id of a new hand: that of the last lost hand of this side, otherwise a new one."""
        lost = [id for id in self._missing(time) if self.known[id].hand == side]
        return max(lost, key=lambda id: self.known[id].since) if lost else len(self.known)

    def _size_beside(self, id: int) -> float | None:
        """The size of another hand, if known: both hands are usually of one person."""
        return next((known.size for other, known in self.known.items() if other != id and known.size), None)

    def _measure(self, follower: Follower, time: float) -> None:
        """Estimate the hand's size as soon as possible."""
        known = self.known[follower.id]
        if follower.size is None and follower.is_decided:
            follower.size = known.size = known.sizes.take(follower.best.sight, time)

    def _middle(self, follower: Follower) -> Array:
        """The hand's position (3,) in mm, camera axes."""
        sight = follower.best.sight
        return self.camera.unproject(self.looker.center_of(sight.body, sight.aim.side))
