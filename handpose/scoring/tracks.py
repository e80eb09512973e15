"""Scores of a track against the truth: errors, lost and false hands, identities, sides, jitter, lag, bones.

scores = score(tracker.header, tracker.follow(recording), recording.truths())  # of a SyntheticRecording
scores.hands[0].lag_ms
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from handpose.body.nyu import ANNOTATION_OF_JOINT, EVALUATION_JOINTS
from handpose.body.sides import Side
from handpose.scoring.matching import BOUND_MM, Followed, match
from handpose.scoring.motion import bone_changes, jitter, lag_s
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.blob import Array

NAN = float("nan")


@dataclass(frozen=True)
class JointErrors:
    """Distances between tracked and true joints in mm, over frames and joints; NaN without any."""

    mean: float = NAN
    median: float = NAN


@dataclass(frozen=True)
class HandScores:
    """The scores of one true hand; NaN where there were no such frames.

    in_sight        number of frames in which it is visible
    found           of these, those in which it is tracked, no farther than the bound
    said_lost       of those in which it is not tracked, those in which the track lists it as lost
    gone            frames in which it is not visible, after it was
    said_gone       of these, those in which the track lists it as lost
    right_reason    of these, those with the right reason
    errors          of all joints, where it is found
    errors14        of the joints that NYU is evaluated on; NaN for other skeletons
    id_switches     number of changes of the tracked id
    wrong_side      frames in which it is tracked as the other hand
    side_switches   number of changes of the tracked side
    side_after      number of frames in which it was found until its side was right; NaN if it never was
    jitter_mm       at rest: deviation of the joints about their mean, see ``motion.Jitter``
    step_mm         at rest: distance from frame to frame
    rest_frames     number of frames at rest
    lag_ms          while it moves
    bone_change_mm  (K,) largest deviation of each bone from its median length; empty if it was never found
    """

    id: int
    hand: Side
    in_sight: int
    found: int
    said_lost: int
    gone: int
    said_gone: int
    right_reason: int
    errors: JointErrors
    errors14: JointErrors
    id_switches: int
    wrong_side: int
    side_switches: int
    side_after: float
    jitter_mm: float
    step_mm: float
    rest_frames: int
    lag_ms: float
    bone_change_mm: tuple[float, ...]

    @property
    def missed(self) -> int:
        """Number of frames in which it is visible and not found."""
        return self.in_sight - self.found


@dataclass(frozen=True)
class TrackScores:
    """The scores of all true hands, by id.

    frames    of the truth
    invented  false positives over all frames
    """

    frames: int
    hands: dict[int, HandScores]
    invented: int

    @property
    def found(self) -> float:
        """Share of the visible hands that were found, over all frames."""
        in_sight = sum(hand.in_sight for hand in self.hands.values())
        return sum(hand.found for hand in self.hands.values()) / in_sight if in_sight else NAN

    @property
    def id_switches(self) -> int:
        """The summary over all hands."""
        return sum(hand.id_switches for hand in self.hands.values())


def score(
    header: TrackHeader, frames: Iterable[TrackedFrame], truth: Iterable[TrackedFrame], bound_mm: float = BOUND_MM
) -> TrackScores:
    """Compare a track with the truth of the same recording. Frames missing from the track have no hands.

    header    of the track
    bound_mm  on the joints' mean error of a hand that is found

    Frames in which a true hand is partly visible are not scored (``handpose.tracking.track``). Raises DataError.
    """
    true = list(truth)
    hands, invented = match(frames, true, bound_mm)
    scores = {id: _scores(header, hand) for id, hand in hands.items()}
    return TrackScores(len(true), scores, sum(invented.values()))


def _scores(header: TrackHeader, hand: Followed) -> HandScores:
    found = [one for one in hand.seen if one.tracked is not None]
    tracked = [one.tracked for one in hand.seen if one.tracked is not None]
    reasons = [(one.true.reason, one.tracked.reason) for one in hand.gone if one.tracked is not None]
    right = [other.hand == hand.hand for other in tracked]
    numbers, times = np.array([one.number for one in found]), np.array([one.time for one in found])
    shape = (len(found), len(header.skeleton.joint_names), 3)
    xyz, true = (
        np.array([one.xyz for one in hands]).reshape(shape) for hands in (tracked, [one.true for one in found])
    )
    off = np.linalg.norm(xyz - true, axis=2)
    shakes = jitter(numbers, times, xyz, true)
    return HandScores(
        id=hand.id,
        hand=hand.hand,
        in_sight=len(hand.seen),
        found=len(found),
        said_lost=sum(one.said_lost for one in hand.seen),
        gone=len(hand.gone),
        said_gone=len(reasons),
        right_reason=sum(reason.startswith(true_reason) for true_reason, reason in reasons),
        errors=_errors(off),
        errors14=_errors(off[:, EVALUATION_JOINTS] if off.shape[1] == len(ANNOTATION_OF_JOINT) else off[:0]),
        id_switches=_changes([other.id for other in tracked]),
        wrong_side=right.count(False),
        side_switches=_changes(right),
        side_after=float(right.index(True)) if any(right) else NAN,
        jitter_mm=shakes.deviation_mm,
        step_mm=shakes.step_mm,
        rest_frames=shakes.frames,
        lag_ms=1000 * lag_s(numbers, times, xyz, true),
        bone_change_mm=tuple(bone_changes(xyz, header.skeleton.parents).tolist()) if tracked else (),
    )


def _errors(off: Array) -> JointErrors:
    return JointErrors(float(off.mean()), float(np.median(off))) if off.size else JointErrors()


def _changes(values: Sequence[int]) -> int:
    return sum(before != after for before, after in itertools.pairwise(values))
