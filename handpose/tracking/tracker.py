"""Tracker: the hands in a depth recording, frame by frame.

with open_recording("frames") as recording:
    tracker = load_tracker(recording.camera)
    for frame in tracker.follow(recording):
        print(frame.time, [hand.xyz for hand in frame.hands], [hand.reason for hand in frame.lost])

The fit of a hand starts from the pose extrapolated from its motion, at intervals also from the network's
prediction, and the better result is used. While there are fewer hands than allowed, the image is searched for more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side
from handpose.estimate.estimator import SearchRegion
from handpose.estimate.hand import MIN_CONFIDENCE, Hand
from handpose.estimate.nets import refuse_other_bodies
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor, check_confidence, check_whole
from handpose.fit.search import ACCURATE, Fit, Plan
from handpose.frames.cameras import Camera
from handpose.frames.crops import NEAR_FACE, check_size
from handpose.frames.images import check_unit, depth_image, without_dropouts
from handpose.frames.recording import DepthFrame
from handpose.tracking.acceptance import Acceptance, Offer
from handpose.tracking.detector import NOWHERE, Detector
from handpose.tracking.hand_track import COAST, ENOUGH, HandTrack
from handpose.tracking.output import tracked_hand
from handpose.tracking.pose_estimator import UNREAD, PoseEstimator
from handpose.tracking.reasons import Expected, reason
from handpose.tracking.sizing import checked
from handpose.tracking.sure_hands import SureHands
from handpose.tracking.track import LostHand, RefusedPlace, TrackedFrame, TrackHeader
from netlib.blob import Array
from netlib.errors import DataError, NetlibError

MAX_HANDS = 100  # larger numbers of hands are invalid
SAME_MM = 70.0  # palms closer together are the same hand
CHECK, SUSPECT = 0.2, 0.08  # s between checks of certain and of uncertain hands
RETURN, RETURN_MM = 2.0, 300.0  # s and mm within which a new hand is a lost one
AGAIN = dataclasses.replace(ACCURATE, quarters=(0,))  # of a tracked hand: its last pose replaces the turned crops
# Limits for covered hands, chosen on one synthetic recording, and MOVED_CONFIDENCE on P1, P4, P6 and moved synthetic
# hands; docs/fit.md has a table of coverings of others.
MAX_COVERED = 0.4  # share of a hand's expected surface that is covered: only a pose that explains this is accepted
MAX_COVERED_MOVED = 0.15  # share of that pose's own surface that is covered, at most
MAX_DEARER = 2.0  # its cost, relative to the average, at most
MOVED_CONFIDENCE = 0.8  # or its confidence in the frame, at least; that of hands at 1 to 2 m/s is 0.87 and more
MAX_UNCOVERED = 1.2  # cost of a pose, relative to the average, up to which the hand is not covered
COVERING_MM = 120.0  # distance of a covering object from the line of sight to the hand's middle, at most
BEHIND_MM = 150.0  # distance behind a covered hand from which another object is not this hand
MAX_REFUSED = 8  # number of places that are refused in the search of one frame
MAX_REJECTIONS = 2  # number of consecutive rejections that end a track


def load_tracker(camera: Camera, *, fit: Fit = "fast", **options: object) -> Tracker:
    """A tracker with the packaged weights; for the options see ``Tracker``. Raises NetlibError."""
    return Tracker(load_predictor(camera, fit=fit), **options)  # type: ignore[arg-type]


class Tracker:
    """Tracks hands.

    predictor  with a locator, a fit, and a camera of the frames' size
    hands      maximum number at a time
    smooth     smooth poses over time
    size       of all hands, relative to the skeleton; by default each is estimated from its first seconds
    surface    output each hand's surface, too
    min_confidence  below it a hand is not reported (``SureHands``); 0 for all hands that are followed

    Raises NetlibError for an unsuitable predictor or number of hands, DataError for a size that cannot be fitted.
    """

    def __init__(
        self, predictor: Predictor, *, hands: int = 2, smooth: bool = True, size: float | None = None,
        surface: bool = False, min_confidence: float = MIN_CONFIDENCE,
    ) -> None:
        if predictor.fitter is None or predictor.locator is None:
            raise NetlibError("a tracker needs a predictor with a fit and a locator")
        check_whole("hands", hands, 1, MAX_HANDS)
        check_confidence(min_confidence)
        refuse_other_bodies(predictor.skeleton, "only hands are followed")
        self.predictor, self.camera = predictor, predictor.camera
        self.limit, self.smooth, self.surface = hands, smooth, surface
        self.size = None if size is None else checked(size)
        self.estimator = PoseEstimator(predictor, self.camera)
        self.detector = Detector(predictor.locator, self.camera)
        self.acceptance = Acceptance(predictor, self.estimator, self.detector)
        self.known: dict[int, HandTrack] = {}  # all hands of the recording by their ids
        self._sure = SureHands(min_confidence)
        self._time = -np.inf
        self._read = False  # True once a frame had a reading

    @property
    def tracks(self) -> list[HandTrack]:
        """The hands that are tracked."""
        return [track for track in self.known.values() if track.is_tracked]

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
        readings, depth, time = self._accept(frame)
        pause = time - self._time
        self._follow(depth, readings, time, pause)
        self._time = time
        self._drop_doubles()
        self._drop_other_objects(depth, readings, time)
        refused = self._search(depth, time, after_gap=pause > COAST)
        return self._sure(self._report(frame.number, readings, time, refused))

    def _accept(self, frame: DepthFrame) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
        """Check a frame; returns its readings (H, W) in mm, those that the camera can measure, and its time."""
        readings, time = np.asarray(depth_image(frame.depth), dtype=np.float32), frame.time
        check_size(readings, self.camera)
        if not self._read:
            check_unit(readings, np.inf)
            self._read = bool((readings > 0).any())
        if not time > self._time:
            raise DataError(f"frame {frame.number} is of {time:g} s, after one of {self._time:g} s; times must ascend")
        readings = without_dropouts(readings)
        return readings, without_dropouts(self.camera.in_range(readings)), time

    def _search(self, depth: NDArray[np.float32], time: float, after_gap: bool) -> list[RefusedPlace]:
        """Search for hands that are not tracked: one, after a gap in time all at once. Returns the refused places."""
        refused: list[RefusedPlace] = []
        while (count := self._count(time)) < self.limit and len(refused) < MAX_REFUSED:
            more = self._detect(depth, time)
            refused += more
            self._drop_doubles()
            # While no hand is tracked, the detector offers a refused place again.
            if not after_gap or (self._count(time) == count and not (more and count)):
                break
            self.detector.restart()
        return refused

    def _report(
        self, number: int, readings: NDArray[np.float32], time: float, refused: list[RefusedPlace]
    ) -> TrackedFrame:
        """The hands that were seen in this frame, however sure, and those that are lost."""
        hands, lost = [], []
        for id, track in sorted(self.known.items()):
            if not (track.is_tracked and track.time == time):
                lost.append(LostHand(id, track.decided, track.since, track.reason))
                continue
            track.since = time
            if track.is_decided:
                track.place = self._middle(track)
                track.size = track.size or track.sizes.take(track.best.estimate, time)
            hand = tracked_hand(track, self.estimator, readings, smooth=self.smooth, surface=self.surface)
            track.trust(hand.confidence / hand.side_confidence, time)
            hands.append(hand)
        return TrackedFrame(number, time, tuple(hands), tuple(lost), tuple(refused))

    def _count(self, time: float) -> int:
        """The number of hands that are tracked and not covered."""
        return sum(track.time == time or not track.covered for track in self.tracks)

    def _follow(self, depth: NDArray[np.float32], readings: NDArray[np.float32], time: float, pause: float) -> None:
        """Find every hand where it is expected; after a long pause, in s since the last frame, it is dropped.

        readings  the image with those readings that are nearer than the camera measures
        """
        self._drop_given_up(time, pause)
        tracks = self.tracks
        for track in tracks:
            track.likely = self._size_beside(track.id)
        regions = {track.id: track.regions(time) for track in tracks}
        estimates = self._estimates(depth, readings, regions)
        others = {track.id: track.other_regions(depth, estimates[track.id], time) for track in tracks}
        again = self._estimates(depth, readings, others, AGAIN)
        for track in tracks:
            seen, more = self._unless_covered(readings, track, estimates[track.id], again[track.id], time)
            # A lost hand must be as sure as a new one. Hands without their surroundings are rarely so sure later: in
            # the scene with a table of docs/fit.md 23% instead of 33% of the labelled hands would be found.
            if track.time < self._time and not track.alone:
                seen, more = ([one for one in hands if one.judged(readings).chance >= ENOUGH] for hands in (seen, more))
            if not track.take(seen, more, time):
                confidence = max((one.chance for one in [*seen, *more]), default=0.0)
                expected = self._expected(readings, track, time)
                track.reason = reason(readings, self.camera, self.estimator.cube_mm, expected, confidence=confidence)

    def _drop_given_up(self, time: float, pause: float) -> None:
        """Drop tracks that were lost or not trusted for too long; after a long pause, all."""
        for track in self.tracks:
            if pause > COAST:
                track.end(f"no frame for {pause:.1f} s, and not found again")
            elif track.given_up(time):
                track.end()
                if track.is_untrusted:
                    self.detector.reject(self._middle(track), time)

    def _unless_covered(
        self, readings: NDArray[np.float32], track: HandTrack, seen: list[Hand], more: list[Hand], time: float
    ) -> tuple[list[Hand], list[Hand]]:
        """The poses of a hand, ``seen`` and ``more``, that what covers it leaves possible; notes if it is covered."""
        least = min((one.selection_cost for one in [*seen, *more]), default=np.inf)
        behind = any((one.crop <= NEAR_FACE).any() for one in [*seen, *more])  # something; then the cost says little
        doubtful = track.covered or behind or least > MAX_UNCOVERED * track.usual_cost
        covered = self._expected(readings, track, time).support.covered[0] if doubtful or more else 0.0
        if doubtful:
            track.covered = bool(covered > MAX_COVERED)
        if track.is_decided and covered > UNREAD:
            # The fits as the other side have no expected pose for what is hidden.
            more = [one for one in more if one.hand == track.hand]
        if track.covered:
            seen, more = ([one for one in hands if self._goes_on(readings, track, one)] for hands in (seen, more))
        return seen, more

    def _estimates(
        self, depth: NDArray[np.float32], readings: NDArray[np.float32], regions: dict[int, list[SearchRegion]],
        plan: Plan | None = None,
    ) -> dict[int, list[Hand]]:
        """The poses in those regions of several hands, by their ids, that are in the image."""
        every = [region for own in regions.values() for region in own]
        estimates = iter(self.estimator.estimate(depth, every, plan, readings))
        found = {id: [next(estimates) for _ in own] for id, own in regions.items()}
        return {id: [one for one in own if one is not None] for id, own in found.items()}

    def _drop_doubles(self) -> None:
        """Drop one of two tracks of the same hand: the one lost earlier, otherwise the worse one."""
        for track in sorted(self.tracks, key=lambda one: (-one.time, one.best.estimate.selection_cost)):
            for other in self.tracks if track.is_tracked else []:
                if other is not track and np.linalg.norm(self._middle(track) - self._middle(other)) < SAME_MM:
                    other.end("another hand is tracked at its position")

    def _expected(self, readings: NDArray[np.float32], track: HandTrack, time: float) -> Expected:
        """A hand where it is expected."""
        return self.estimator.expected(readings, track.best.expected(time), track.hand)

    def _goes_on(self, readings: NDArray[np.float32], track: HandTrack, found: Hand) -> bool:
        """True if a pose explains what is in front of the expected one, or that it is not read: the hand has moved.

        Otherwise the pose is a guess from the rest of a covered hand, or the object that covers it.
        """
        dear = found.selection_cost > MAX_DEARER * track.usual_cost
        if dear and found.judged(readings).chance < MOVED_CONFIDENCE:
            return False
        if self.estimator.support(readings, found).covered[0] >= MAX_COVERED_MOVED:
            return False
        return not self.acceptance.is_flat(readings, found)

    def _drop_other_objects(self, depth: NDArray[np.float32], readings: NDArray[np.float32], time: float) -> None:
        """Drop tracks of objects that are not hands, which network and fit may resemble."""
        for track in self.tracks:
            pause = CHECK if track.is_sure else SUSPECT
            if track.time < time or time - track.checked < pause:
                continue
            track.checked = time
            doubt = self.acceptance.doubt(depth, track.best.estimate)
            track.rejections = track.rejections + 1 if doubt else 0
            if track.rejections >= MAX_REJECTIONS:
                expected = self._expected(readings, track, time)
                track.end(reason(readings, self.camera, self.estimator.cube_mm, expected, doubt))

    def _detect(self, depth: NDArray[np.float32], time: float) -> list[RefusedPlace]:
        """Search for a hand that is not tracked. Returns the place that was refused, if any."""
        middles = np.array([self._middle(track) for track in self.tracks]).reshape(-1, 3)
        arms = [self.estimator.arm(track.best.estimate) for track in self.tracks]
        place = self.detector.detect(depth, middles, time, np.concatenate([*arms, NOWHERE]))
        if place is None:
            return []
        doubts = list(filter(None, (self._in_line(place, track, time) for track in self.tracks)))
        seen, why, alone = Offer([], doubts[-1]) if doubts else self.acceptance.hands_at(depth, place)
        if not seen:
            self.detector.reject(place, time)
            x, y, z = place.tolist()
            return [RefusedPlace((x, y, z), why)]
        returned = self._just_lost(place, time)
        seen = [estimate for estimate in seen if estimate.hand in returned] or seen
        track = HandTrack(self.estimator, seen, time, self.size, self._side_prior(time), alone)
        id = self._id_of(track.hand, time)
        track.identify(id, self.known.get(id))
        self.known[id] = track
        return []

    def _in_line(self, place: Array, track: HandTrack, time: float) -> str:
        """Why a place (3,) in mm on the line of sight to a covered hand is no hand; empty if it is not on it.

        It is what covers the hand, or what is seen next to the covering, behind the hand.
        """
        if track.time == time or not track.covered:
            return ""
        middle = self.estimator.center_of(track.best.expected(time), track.hand)
        u, v, d = (self.camera.project(place) - middle).tolist()
        reach = COVERING_MM * self.camera.fx / min(place[2], middle[2])
        if max(abs(u), abs(v)) >= reach or 0 <= d < BEHIND_MM:
            return ""
        return "it covers a tracked hand" if d < 0 else "it is behind a covered hand"

    def _missing(self, time: float) -> list[int]:
        """The ids of known hands that are not found in this frame."""
        return [id for id, track in self.known.items() if not (track.is_tracked and track.time == time)]

    def _just_lost(self, place: Array, time: float) -> set[Side]:
        """The sides of hands lost recently near a place (3,) in mm, because a hand does not change its side."""
        known = [self.known[id] for id in self._missing(time) if time - self.known[id].since < RETURN]
        near = [one for one in known if one.place is not None and np.linalg.norm(one.place - place) < RETURN_MM]
        return {one.decided for one in near if one.decided is not None}

    def _side_prior(self, time: float) -> float:
        """Prior evidence for a right hand (1) or a left one (-1): lost hands return."""
        sides = [self.known[id].decided for id in self._missing(time)]
        return float("right" in sides) - float("left" in sides)

    def _id_of(self, side: Side, time: float) -> int:
        """The id of a new hand: that of the last lost hand of this side, otherwise a new one."""
        lost = [id for id in self._missing(time) if self.known[id].decided in (side, None)]
        return max(lost, key=lambda id: self.known[id].since) if lost else len(self.known)

    def _size_beside(self, id: int) -> float | None:
        """The size of another hand, if known: both hands are usually of one person."""
        return next((known.size for other, known in self.known.items() if other != id and known.size), None)

    def _middle(self, track: HandTrack) -> Array:
        """The hand's position (3,) in mm, camera axes."""
        estimate = track.best.estimate
        return self.camera.unproject(self.estimator.center_of(estimate.body, estimate.hand))
