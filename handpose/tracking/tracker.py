"""Tracker: the hands in a depth recording, frame by frame.

with open_recording("frames") as recording:
    tracker = load_tracker(recording.camera)
    for frame in tracker.follow(recording):
        print(frame.time, [hand.xyz for hand in frame.hands], [hand.reason for hand in frame.lost])

The fit of a hand starts from the pose extrapolated from its motion, at intervals also from
the network's prediction, and the better result is used. While fewer hands than allowed have a
sure pose, the finder looks for more. What it sees is present; a hand is followed once there
is a pose, too.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator
from numbers import Real

import numpy as np

from handpose.body.sides import Side, SideView, SoughtSide, mirror_of
from handpose.estimate.candidates import SearchRegion
from handpose.estimate.finder import FoundHand
from handpose.estimate.hand import MIN_CONFIDENCE, MIN_PRESENCE, HandEstimate
from handpose.estimate.nets import refuse_other_bodies
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor, check_probability, check_whole
from handpose.fit.settings import Fit, FitSettings
from handpose.frames.cameras import Camera
from handpose.frames.crops import check_size
from handpose.frames.images import check_unit, depth_image, without_dropouts
from handpose.frames.recording import DepthFrame
from handpose.tracking.hand_track import FrameHands, HandTrack
from handpose.tracking.output import tracked_hand
from handpose.tracking.present_hands import PresentHands, PresentPlace, Taken
from handpose.tracking.reasons import NO_POSE, why_missing
from handpose.tracking.reporting import SureHands
from handpose.tracking.settings import TrackSettings
from handpose.tracking.sizing import checked
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import DataError, NetlibError

MAX_HANDS = 100  # larger numbers of hands are invalid
ARM_PLACES = 5  # along a forearm, where what is found is the arm


def load_tracker(
    camera: Camera,
    *,
    hand: SoughtSide = "either",
    fit: Fit = "fast",
    seed: int = 0,
    fit_settings: FitSettings = FitSettings(),
    **options: object,
) -> Tracker:
    """A tracker with the packaged weights. ``hand`` is the side of all hands, if known; ``seed``
    and settings are those of its fits, other options those of ``Tracker``.

    Raises NetlibError.
    """
    predictor = load_predictor(camera, hand=hand, fit=fit, seed=seed, settings=fit_settings)
    return Tracker(predictor, **options)  # type: ignore[arg-type]


class Tracker:
    """Tracks hands.

    predictor  with a finder, a fit, and a camera of the frames' size
    hands      maximum number at a time
    smooth     smooth poses over time
    size       of all hands, relative to the skeleton; by default each is estimated from
               its first seconds
    min_presence    below it a found place is no hand
    min_confidence  below it a hand is not reported (``SureHands``); 0 for all hands
                    that are followed
    settings    tuned numbers, besides those of the predictor

    Raises NetlibError for an unsuitable predictor or number of hands, DataError for a size that
    cannot be fitted.
    """

    def __init__(
        self,
        predictor: Predictor,
        *,
        hands: int = 2,
        smooth: bool = True,
        size: float | None = None,
        min_confidence: float = MIN_CONFIDENCE,
        min_presence: float = MIN_PRESENCE,
        settings: TrackSettings = TrackSettings(),
    ) -> None:
        if predictor.fitter is None or predictor.finder is None:
            raise NetlibError("a tracker needs a predictor with a fit and a finder")
        check_whole("hands", hands, 1, MAX_HANDS)
        check_probability("min_confidence", min_confidence)
        check_probability("min_presence", min_presence)
        refuse_other_bodies(predictor.skeleton, "only hands are followed")
        self.predictor, self.camera = predictor, predictor.camera
        self.limit, self.smooth = hands, smooth
        self.size = None if size is None else checked(size)
        self.estimator, self.model = predictor.estimator, predictor.fitter.model
        self.finder, self.min_presence = predictor.finder, min_presence
        self.settings = settings
        self.present = PresentHands(min_presence, settings.present)
        self._searched = -np.inf  # s, when further hands were searched for
        # all hands of the recording by the tracker's own ids (``SureHands.ids``)
        self.known: dict[int, HandTrack] = {}
        self._sure = SureHands(min_confidence, settings)
        self._accurate = accurate = predictor.settings.search.accurate
        # of a tracked hand: its last pose replaces the turned crops
        trials = accurate.trials and accurate.trials._replace(turns=1)
        self._again = dataclasses.replace(accurate, trials=trials)
        self._time = -np.inf
        self._read = False  # True once a frame had a reading

    @property
    def tracks(self) -> list[HandTrack]:
        """The hands that are tracked."""
        return [track for track in self.known.values() if track.is_tracked]

    def track_of(self, hand: TrackedHand) -> HandTrack:
        """The state of a hand that ``step`` returned last."""
        return next(track for id, track in self.known.items() if self._sure.ids.get(id) == hand.id)

    def header(self, source: str) -> TrackHeader:
        """The header of the track."""
        return TrackHeader(
            source, self.camera, self.predictor.skeleton, self.predictor.cube_mm / 2, self.smooth
        )

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[TrackedFrame]:
        """The hands of all frames, in the order of their times. Raises DataError, NetlibError."""
        for frame in frames:
            yield self.step(frame)

    def step(self, frame: DepthFrame) -> TrackedFrame:
        """The hands of the next frame.

        Raises DataError for another size, or a time that is not later; NetlibError, also for what
        is no ``DepthFrame``.

        Raises UnitError for the first frame with readings if these are in metres or negative.
        """
        if not isinstance(frame, DepthFrame):
            what = type(frame).__name__
            raise NetlibError(
                f"the frame is a {what}; expected a DepthFrame, as recordings have: its number, the "
                "time in s, and the depth in mm"
            )
        before = self._time
        view, time = self._accept(frame)
        found = FrameHands(self.finder, view, self.present.still_presence)
        self._follow(found, time, before)
        self._drop_doubles()
        follow, present = self.settings.follow, self.settings.present
        pause = present.later_s if self.tracks else present.soon_s
        waited = time - self._searched >= pause or time - before > follow.max_extrapolation_s
        sure = sum(track.best.estimate.chance >= follow.sure for track in self.tracks)
        if (found.is_known or waited) and sure < self.limit:
            self._searched = time
            self._search(found, time)
            self._drop_doubles()
        return self._sure(self._report(frame.number, time))

    def _accept(self, frame: DepthFrame) -> tuple[SideView, float]:
        """Check a frame; returns it, as the first side that is sought sees it, and its time."""
        readings, time = np.asarray(depth_image(frame.depth), dtype=np.float32), frame.time
        check_size(readings, self.camera)
        if not self._read:
            check_unit(readings, np.inf)
            self._read = bool((readings > 0).any())
        if not isinstance(time, Real) or not self._time < time < np.inf:
            raise DataError(
                f"frame {frame.number} is of {time} s, after one of {self._time:g} s; times must ascend"
            )
        self._time = time
        raw = SideView("right", self.camera, readings, readings).of(self.predictor.sides[0])
        every = without_dropouts(np.ascontiguousarray(raw.readings))
        depth = without_dropouts(self.camera.in_range(every))
        return SideView(raw.side, raw.camera, depth, every), time

    def _follow(self, found: FrameHands, time: float, before: float) -> None:
        """Find every hand where it is expected, in a frame after one at the time ``before``."""
        tracks, view = self.tracks, found.view
        regions = {track.id: track.regions(time, before) for track in tracks}
        estimates = self._estimates(view, regions)
        for track in tracks:
            seen = estimates[track.id]
            more = self._other_estimates(track, found, seen, time)
            if not track.take(seen, more, time, before):
                track.reason = self._reason(track, found, [*seen, *(more or ())], time)

    def _reason(
        self, track: HandTrack, found: FrameHands, seen: list[HandEstimate], time: float
    ) -> str:
        """The reason why none of the poses ``seen`` in a frame at a time is good enough."""
        if found.near(track.place, self.settings.present.same_mm):
            return NO_POSE
        confidence = max((one.chance for one in seen), default=0.0)
        own, pose = found.view.of(track.hand), track.best.expected(time)
        return why_missing(self.estimator.expected, own, pose, confidence)

    def _estimates(
        self, view: SideView, regions: dict[int, list[SearchRegion]]
    ) -> dict[int, list[HandEstimate]]:
        """The poses in those regions of several hands, by their ids, that are in the image."""
        every = [region for own in regions.values() for region in own]
        estimates = iter(self.estimator.in_regions(view, every))
        return {
            id: [one for one in itertools.islice(estimates, len(own)) if one]
            for id, own in regions.items()
        }

    def _other_estimates(
        self, track: HandTrack, found: FrameHands, seen: list[HandEstimate], time: float
    ) -> list[HandEstimate] | None:
        """The poses by full fits of a hand that is uncertain; None if there is no need."""
        regions = track.other_regions(found, seen, time)
        if not regions:
            return None
        view = found.weighted(track.place, self.settings.present.same_mm)
        return [one for one in self.estimator.in_regions(view, regions, self._again) if one]

    def _drop_doubles(self) -> None:
        """Drop one of two tracks at the same place: the one seen earlier, otherwise
        the worse one.
        """
        apart_mm = self.predictor.settings.finder.apart_mm
        best_first = sorted(
            self.tracks, key=lambda one: (-one.time, one.best.estimate.selection_cost)
        )
        for track in best_first:
            others = [one for one in self.tracks if track.is_tracked and one is not track]
            for other in others:
                if np.linalg.norm(self._middle(track) - self._middle(other)) < apart_mm:
                    other.end("another hand is tracked at its position")
                    if track.decided == other.decided or None in (track.decided, other.decided):
                        self._merge(track, other)

    def _merge(self, track: HandTrack, other: HandTrack) -> None:
        """Forget a track that followed the same hand as one that goes on, under the id of
        the older one.
        """
        del self.known[other.id]
        if other.begun < track.begun:
            del self.known[track.id]
            track.identify(other.id, other)
            self.known[track.id] = track

    def _search(self, found: FrameHands, time: float) -> None:
        """Begin to follow the hands that the finder sees and that have a sure pose."""
        for track in self.tracks:
            track.look(found)
        self.present.see(found.hands, found.view, self._taken(), time)
        for place in self.present.there:
            place.is_sure |= self._was_followed(place, time)
        self._drop_less_present()
        start = self.settings.start
        for place in self.present.due(time):
            if len(self.tracks) == self.limit:
                break
            if place.presence < start.both:  # no confidence is enough
                continue
            place.wait(time, at_once=not self.tracks)
            seen = self._seen_at(place.hand, found.view, self.size)
            confidence = max((one.chance for one in seen), default=0.0)
            is_sure = place.presence * confidence >= start.both
            if is_sure and (confidence >= start.beside or not self.tracks):
                known = self.size, self._side_prior(), place.presence
                track = HandTrack(self.estimator, self.settings, seen, time, *known)
                self._begin(track, place)

    def _was_followed(self, place: PresentPlace, time: float) -> bool:
        """True if a hand was followed there until a moment ago."""
        recent_s, same_mm = self.settings.follow.recent_s, self.settings.present.same_mm
        recent = (track for track in self.known.values() if time - track.time <= recent_s)
        return any(np.linalg.norm(track.place - place.hand.middle) < same_mm for track in recent)

    def _begin(self, track: HandTrack, place: PresentPlace) -> None:
        """Follow a hand that was found at a place."""
        track.identify(id := self._id_of(track.hand, place.id), self.known.get(id))
        self.known[id] = track
        self.present.places.remove(place)

    def _taken(self) -> list[Taken]:
        """The middles of tracked hands, and the places on their arms."""
        taken = []
        for track in self.tracks:
            taken += [
                Taken(track.place, np.inf),
                *(Taken(place, track.hand_chance) for place in _arm(track.best.estimate)),
            ]
        return taken

    def _drop_less_present(self) -> None:
        """Drop the least evident of as many tracks as are wanted if another hand is sure
        and more present.
        """
        for place in filter(lambda one: one.is_sure, self.present.there):
            if len(self.tracks) < self.limit:
                break
            least = min(self.tracks, key=lambda track: track.hand_chance)
            if least.hand_chance < place.presence:
                least.end("another hand is more present")

    def _seen_at(self, hand: FoundHand, view: SideView, size: float | None) -> list[HandEstimate]:
        """The poses of a found hand as one of each side; none if a fast fit has
        little confidence.
        """
        view = view.weighted(hand.weight)
        start = view.camera.project(hand.middle * mirror_of(view.side))
        try:
            first = self.estimator.in_frame(view, start, is_middle=True)
        except DataError:  # outside the image, or behind the camera
            return []
        if first.chance < self.settings.start.first:
            return []
        seen = view.of(first.hand)
        regions = [
            SearchRegion(seen.pixel_in(side, first.view_uvd), side, size=size)
            for side in self.predictor.sides
        ]
        return [one for one in self.estimator.in_regions(view, regions, self._accurate) if one]

    def _report(self, number: int, time: float) -> TrackedFrame:
        """The hands that were seen in this frame, however sure, and those that are lost."""
        every = []
        for _, track in sorted(self.known.items()):
            if not (track.is_tracked and track.time == time):
                every.append(self._without_pose(track))
                continue
            if track.is_decided:
                track.sizes.take(track.best.estimate, time)
            every.append(tracked_hand(track, self.model, smooth=self.smooth))
        for place in self.present.evident[: self.limit - len(self.tracks)]:
            is_seen = place.time == self._searched
            present = _present(place.id, place.hand, place.presence)
            mask = present.mask if is_seen else None
            every.append(
                dataclasses.replace(present, is_sure=place.is_sure, is_seen=is_seen, mask=mask)
            )
        return TrackedFrame(number, time, tuple(every))

    def _without_pose(self, track: HandTrack) -> TrackedHand:
        """A hand without a pose in this frame. A followed hand that the finder saw in its last
        look is present; another one is lost.
        """
        presence, hand = track.looks
        if track.is_tracked and hand is not None and presence >= self.min_presence:
            return dataclasses.replace(_present(track.id, hand, presence), hand=track.decided)
        return TrackedHand(track.id, track.decided, since=track.time, reason=track.reason)

    def _lost(self) -> list[int]:
        """The ids of known hands that are not followed any more."""
        return [id for id, track in self.known.items() if not track.is_tracked]

    def _side_prior(self) -> float:
        """The prior log-ratio, 1 for a right hand and -1 for a left one: lost hands return."""
        sides = [self.known[id].decided for id in self._lost()]
        return float("right" in sides) - float("left" in sides)

    def _id_of(self, side: Side, new: int) -> int:
        """The id of a new hand: that of the last lost hand of this side, otherwise
        a ``new`` one.
        """
        lost = [id for id in self._lost() if self.known[id].decided in (side, None)]
        return max(lost, key=lambda id: self.known[id].time) if lost else new

    def _middle(self, track: HandTrack) -> Array:
        """The hand's position (3,) in mm, camera axes."""
        estimate = track.best.estimate
        camera = estimate.view_camera
        place = camera.unproject(self.estimator.expected.center_of(estimate.body, camera))
        return place * mirror_of(estimate.hand)


def _present(id: int, hand: FoundHand, presence: float) -> TrackedHand:
    """A hand that the finder saw in its last look, without a pose."""
    x, y, z = hand.middle.tolist()
    return TrackedHand(
        id, None, confidence=0.0, reason=NO_POSE, presence=presence, place=(x, y, z), mask=hand.mask
    )


def _arm(hand: HandEstimate) -> Array:
    """Positions (A, 3) in mm, camera axes, along the capsules of the surface alone: the forearm."""
    capsules, limbs = hand.capsules(in_space=True), hand.the_model.surface.limbs
    a, b = capsules.a[0, limbs], capsules.b[0, limbs]
    shares = np.linspace(0, 1, ARM_PLACES)[:, None]
    places = a[:, None] + shares * (b - a)[:, None]
    return places.reshape(-1, 3)
