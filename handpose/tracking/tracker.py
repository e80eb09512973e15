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

from handpose.data.crops import check_size
from handpose.data.images import check_unit, depth_image
from handpose.depth_fit.rejection import STRETCHED_MM
from handpose.depth_fit.search import ACCURATE, FAST, Fit, Plan
from handpose.facts.cameras import Camera
from handpose.facts.sides import Side, mirror_of
from handpose.prediction.nets import refuse_other_bodies
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor, check_whole
from handpose.sources.recording import DepthFrame
from handpose.track_files.track import LostHand, TrackedFrame, TrackHeader
from handpose.tracking.detector import NOWHERE, Detector
from handpose.tracking.hand_track import COAST, ENOUGH, HandTrack
from handpose.tracking.output import tracked_hand
from handpose.tracking.pose_estimator import LIKELY, Estimate, PoseEstimator, SearchRegion
from handpose.tracking.reasons import NO_HAND, reason
from handpose.tracking.sizing import SizeKeeper, checked
from netlib.blob import Array
from netlib.errors import DataError, NetlibError

MAX_HANDS = 100  # larger numbers of hands are invalid
SAME_MM = 70.0  # palms closer together are the same hand
# Limits of the rejection score of new and of tracked hands. In synthetic scenes with three cameras 92% of 187 hands are
# below 100 mm and 99% below 135 mm; of other things that the detector offers, the lowest has 113 mm. Before the search,
# fitted fast at the place itself, the hands that are accepted later have at most 116 mm.
REJECT_NEW_MM, REJECT_FIRST_MM, REJECT_MM = 100.0, 120.0, 135.0
CHECK, SUSPECT = 0.2, 0.08  # s between checks of certain and of uncertain hands
RETURN, RETURN_MM = 2.0, 300.0  # s and mm within which a new hand is a lost one
AGAIN = dataclasses.replace(ACCURATE, quarters=(0,))  # of a tracked hand: its last pose replaces the turned crops
MAX_REJECTIONS = 2  # number of consecutive rejections that end a track


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
    surface    output each hand's surface, too

    Raises NetlibError for an unsuitable predictor or number of hands, DataError for a size that cannot be fitted.
    """

    def __init__(
        self, predictor: Predictor, *, hands: int = 2, smooth: bool = True, size: float | None = None,
        surface: bool = False,
    ) -> None:  # fmt: skip
        if predictor.fitter is None or predictor.locator is None:
            raise NetlibError("a tracker needs a predictor with a fit and a locator")
        check_whole("hands", hands, 1, MAX_HANDS)
        refuse_other_bodies(predictor.skeleton, "only hands are followed")
        self.predictor, self.camera = predictor, predictor.camera
        self.limit, self.smooth, self.surface = hands, smooth, surface
        self.size = None if size is None else checked(size)
        self.estimator = PoseEstimator(predictor, self.camera)
        self.detector = Detector(predictor.locator, self.camera)
        self.tracks: list[HandTrack] = []
        self.known: dict[int, Known] = {}
        self._time = -np.inf
        self._read = False  # True once a frame had a reading

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
        depth = self.camera.in_range(depth)
        self._follow(depth, time)
        after_gap, self._time = time - self._time > COAST, time
        self._drop_doubles()
        self._drop_other_objects(depth, time)
        while (count := len(self.tracks)) < self.limit:
            self._detect(depth, time)
            self._drop_doubles()
            if not after_gap or len(self.tracks) == count:
                break
            self.detector.restart()  # after a gap in time, search for all hands at once
        hands = []
        for track in sorted(self.tracks, key=lambda one: one.id):
            if track.time == time:
                self._measure(track, time)
                self.known[track.id].since = time
                if track.is_decided:
                    self.known[track.id].place = self._middle(track)
                hands.append(tracked_hand(track, self.estimator, smooth=self.smooth, surface=self.surface))
        lost = tuple(
            LostHand(id, known.hand, known.since, known.reason)
            for id, known in sorted(self.known.items())
            if all(id != hand.id for hand in hands)
        )
        return TrackedFrame(frame.number, time, tuple(hands), lost)

    def _follow(self, depth: NDArray[np.float32], time: float) -> None:
        """Find every hand where it is expected; after a gap in time it is dropped."""
        for track in list(self.tracks):
            if track.given_up(time):
                self.tracks.remove(track)
                if time - self._time > COAST:
                    self.known[track.id].reason = f"no frame for {time - self._time:.1f} s, and not found again"
        for track in self.tracks:
            track.likely = self._size_beside(track.id)
        regions = {track.id: track.regions(time) for track in self.tracks}
        estimates = self._estimates(depth, regions)
        others = {track.id: track.other_regions(depth, estimates[track.id], time) for track in self.tracks}
        again = self._estimates(depth, others, AGAIN)
        for track in list(self.tracks):
            known, seen = self.known[track.id], [*estimates[track.id], *again[track.id]]
            if track.take(estimates[track.id], again[track.id], time):
                known.hand = track.best.estimate.region.side
                continue
            best = min((s for s in seen if s is not None), key=lambda s: s.selection_cost, default=None)
            known.reason = reason(depth, self.camera, self.estimator.cube_mm, regions[track.id][0], best)

    def _estimates(
        self, depth: NDArray[np.float32], regions: dict[int, list[SearchRegion]], plan: Plan | None = None
    ) -> dict[int, list[Estimate | None]]:
        """The poses in regions of several hands, by their ids."""
        estimates = iter(self.estimator.estimate(depth, [region for own in regions.values() for region in own], plan))
        return {id: [next(estimates) for _ in own] for id, own in regions.items()}

    def _drop_doubles(self) -> None:
        """Drop one of two tracks of the same hand: the one lost earlier, otherwise the worse one."""
        for track in sorted(self.tracks, key=lambda one: (-one.time, one.best.estimate.selection_cost)):
            if track not in self.tracks:
                continue
            for other in list(self.tracks):
                if other is not track and np.linalg.norm(self._middle(track) - self._middle(other)) < SAME_MM:
                    self.tracks.remove(other)
                    self.known[other.id].reason = "another hand is tracked at its position"

    def _drop_other_objects(self, depth: NDArray[np.float32], time: float) -> None:
        """Drop tracks of objects that are not hands, which network and fit may resemble."""
        for track in list(self.tracks):
            pause = CHECK if track.is_sure else SUSPECT
            if track.time < time or time - track.checked < pause:
                continue
            track.checked = time
            thickness = self.known[track.id].sizes.thickness  # which alone is no reason to reject a hand
            limit = REJECT_MM + STRETCHED_MM * abs(np.log(thickness))
            good = self._looks_like_a_hand(depth, track.best.estimate, limit)
            track.rejections = 0 if good else track.rejections + 1
            if track.rejections >= MAX_REJECTIONS:
                self.tracks.remove(track)
                estimate = track.best.estimate
                why = reason(depth, self.camera, self.estimator.cube_mm, estimate.region, estimate)
                self.known[track.id].reason = NO_HAND if why.startswith(NO_HAND) else why

    def _looks_like_a_hand(self, depth: NDArray[np.float32], estimate: Estimate, limit_mm: float) -> bool:
        """True if the locator finds a hand and the rejection score is low enough."""
        if self.detector.probability(depth, estimate.center_mm * mirror_of(estimate.region.side)) < LIKELY:
            return False
        return self.estimator.rejection_score(estimate) < limit_mm

    def _detect(self, depth: NDArray[np.float32], time: float) -> None:
        """Search for a hand that is not tracked."""
        middles = np.array([self._middle(track) for track in self.tracks]).reshape(-1, 3)
        arms = [self.estimator.arm(track.best.estimate) for track in self.tracks]
        place = self.detector.detect(depth, middles, time, np.concatenate([*arms, NOWHERE]))
        if place is None:
            return
        seen = self._hands_at(depth, place)
        if not seen:
            self.detector.reject(place, time)
            return
        returned = self._just_lost(place, time)
        seen = [estimate for estimate in seen if estimate.region.side in returned] or seen
        track = HandTrack(-1, self.estimator, seen, time, self.size, self._side_prior(time))
        track.id = self._id_of(track.hand, time)
        known = self.known.setdefault(track.id, Known(track.hand, time, "", SizeKeeper(self.estimator), self.size))
        known.since, known.hand, track.size = time, track.hand, known.size
        self.tracks = [other for other in self.tracks if other.id != track.id] + [track]

    def _hands_at(self, depth: NDArray[np.float32], place: Array) -> list[Estimate]:
        """The poses near a place (3,) in mm, as hands of each side; empty if it is not a hand.

        A fast prediction at the place itself comes first. It rejects most of the other objects before the slow search.
        """
        start = self.camera.project(place)
        if all(
            self.estimator.rejection_score(estimate) > REJECT_FIRST_MM
            for estimate in self._sides_at(depth, start, FAST)
        ):
            return []
        try:
            found = self.predictor.hands_at(depth, [start], [0.0])[0]
        except DataError:  # out of sight
            return []
        if found.fit is None or found.fit.rejection_score > REJECT_MM:
            return []
        seen = self._sides_at(depth, found.center_uvd, ACCURATE)
        if not seen or max(s.confidence for s in seen) < ENOUGH:
            return []
        best = min(seen, key=lambda s: s.uncertainty)
        return seen if self._looks_like_a_hand(depth, best, REJECT_NEW_MM) else []

    def _sides_at(self, depth: NDArray[np.float32], center_uvd: Array, plan: Plan) -> list[Estimate]:
        """The poses in a crop about a centre (3,), as a hand of each side; none if it is outside the image."""
        regions = [SearchRegion(center_uvd, side) for side in self.predictor.sides]
        return [estimate for estimate in self.estimator.estimate(depth, regions, plan) if estimate is not None]

    def _missing(self, time: float) -> list[int]:
        """The ids of known hands that are not found in this frame."""
        seen = {track.id for track in self.tracks if track.time == time}
        return [id for id in self.known if id not in seen]

    def _just_lost(self, place: Array, time: float) -> set[Side]:
        """The sides of hands lost recently near a place (3,) in mm, because a hand does not change its side."""
        known = [self.known[id] for id in self._missing(time)]
        return {
            one.hand
            for one in known
            if one.place is not None and time - one.since < RETURN and np.linalg.norm(one.place - place) < RETURN_MM
        }

    def _side_prior(self, time: float) -> float:
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

    def _measure(self, track: HandTrack, time: float) -> None:
        """Estimate the hand's size as soon as possible."""
        known = self.known[track.id]
        if track.size is None and track.is_decided:
            track.size = known.size = known.sizes.take(track.best.estimate, time)

    def _middle(self, track: HandTrack) -> Array:
        """The hand's position (3,) in mm, camera axes."""
        estimate = track.best.estimate
        return self.camera.unproject(self.estimator.center_of(estimate.body, estimate.region.side))
