"""The tuned numbers of tracking, as ``handpose.fit.settings`` of fits: a ``Tracker`` passes them
down to where they are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from handpose.fit.settings import Stage


@dataclass(frozen=True)
class StartSettings:
    """When a found hand is followed (``Tracker``)."""

    first: float = 0.1  # a place is fitted accurately from this confidence of a fast fit on
    # Minimum product of presence and confidence of a hand that is followed. In the six labelled
    # recordings, as recorded and mirrored, it is at least 0.36 where a track of the hand begins,
    # and at most 0.29 elsewhere, for instance at an elbow.
    both: float = 0.33
    # Minimum confidence of a second hand. In these recordings, which show one hand, the confidence
    # at other places with enough presence is at most 0.51.
    beside: float = 0.6


@dataclass(frozen=True)
class FollowSettings:
    """When a pose is one, how long a hand is followed without any, and where its next pose is
    expected (``HandTrack``).
    """

    enough: float = 0.3  # confidence of a pose, below which it is none
    sure: float = 0.9  # confidence below which a full fit is run
    # s; a second with poses earns two of credit, one without costs one; a hand without is lost
    first_credit: float = 0.4
    most_credit: float = 1.0
    max_extrapolation_s: float = 0.4  # by which a motion is extended at most
    kept: float = 0.7  # damping of the expected motion
    new: float = 0.6  # weight of the last two frames in the velocity
    # 4 m/s at 30 frames per second: a pose that is found farther away is no motion of the hand
    max_jump_mm: float = 130.0

    @property
    def recent_s(self) -> float:
        """For which a hand counts as one with joints after it had them: twice as long as a track
        goes on without a pose.
        """
        return 2 * self.most_credit


@dataclass(frozen=True)
class SideSettings:
    """When the side of a hand is decided. It is decided by the mean log-ratio of the costs of the
    fits as either side. On real recordings a single ratio has the right sign in 64% to 100% of the
    frames, and the mean of the first second always.
    """

    # s of comparisons: at least, at most; and their minimum number
    min_s: float = 1.0
    max_s: float = 3.0
    min_times: int = 6
    clear: float = 0.1  # mean ratio that decides before the maximum
    # probability of a side that is reported at the end of a recording, before it was decided
    min_probability: float = 0.69


@dataclass(frozen=True)
class PresentSettings:
    """Hands that a finder sees and that have no sure pose (``PresentHands``)."""

    # a hand this close to one that is followed, or to one of the search before, is the same
    same_mm: float = 110.0
    # part of the minimum presence that is enough for a hand that was there before, and of the
    # highest evidence that is enough for another hand
    still: float = 0.5
    look: float = 0.5  # weight of the last look in the mean presence
    # Minimum change of a surface's depth, in units of the camera's noise, the median change in the
    # frame. 8 to 12 give the same results; with 5, the noise on a dark chair counts as a change.
    noises: float = 8.0
    # Maximum time between two looks that are compared: later, things may have been moved. 0.3 to 4
    # give the same results at a desk and with a Kinect v2; neither recording has a longer pause.
    compared_s: float = 1.0
    # Seconds between two runs of a slow step: a search for another hand, a pose at a place, a full
    # fit of an uncertain hand, a prediction that competes with the tracked pose; the same while
    # there is no hand, no pose or no decided side.
    later_s: float = 0.2
    soon_s: float = 0.1
    max_pause_s: float = 4.0  # pauses at one place are doubled after each try
    # Evidence from which a place is a hand also beside a hand with joints. On two recordings of one
    # hand (CVAR's P4 and P6), places on still things, such as a keyboard, reach a presence of 0.67.
    # A second hand laid into these recordings has 0.71 to 0.85 where its pose is not found, but
    # down to 0.37 at a distance of 0.7 m.
    sure: float = 0.75
    # Number of frames with joints that make a hand one that can be lost. In recordings of one hand
    # and of two, the hands that are lost have 17 or more, a hand that is found twice in its first
    # frame has 1.
    min_given: int = 3


@dataclass(frozen=True)
class SizeSettings:
    """The poses from which the size of a hand is estimated (``sizing``)."""

    poses: int = 32  # number of poses, of which the half with the lower costs is used
    min_interval_s: float = 0.1  # between poses, which must differ
    min_confidence: float = 0.5  # of a pose
    stages: tuple[Stage, Stage] = (Stage(15.0, 4), Stage(10.0, 3))  # of the fits of each size


class Cutoff(NamedTuple):
    """f_min in Hz, β in Hz per unit of speed, the cutoff in Hz of the speed, κ, the bound of κ n̂,
    γ in Hz per unit, and δ.
    """

    min_hz: float
    slope: float
    speed_hz: float
    noise: float = 0.0
    max_noise: float = math.inf
    gap_slope: float = 0.0
    min_gap: float = 0.0


@dataclass(frozen=True)
class SmoothSettings:
    """The filter of poses (``smoothing``).

    The cutoffs were chosen on synthetic movements with three cameras that are in no reported
    result; the gaps on the real hands P1, P4 and hpx, and on two synthetic recordings, whose jitter
    they raise by less than 2%.
    """

    place: Cutoff = Cutoff(0.5, 0.4, 2.7, 1.3, 25.0)  # per mm/s
    rotation: Cutoff = Cutoff(0.8, 45.0, 4.0, 2.1, 0.5, 200.0, 0.03)  # per rad/s, rad
    others: Cutoff = Cutoff(
        0.8, 15.0, 0.75, 1.05, 0.4, 150.0, 0.06
    )  # likewise; logarithms of sizes
    scatter_hz: float = 0.3  # cutoff of the logarithm of n̂
    power: int = 3  # of the ratio of the errors: less trust in poses with a large expected error
    min_trust: float = 0.1  # minimum trust, because a hand may move meanwhile


@dataclass(frozen=True)
class LaterSettings:
    """What later frames of a recording change (``LaterFrames``)."""

    # Frames are released once this time, in s, after them is known. Twice as much is held, so that
    # frames are filtered backwards twice at most. On two synthetic recordings (the scripts
    # `gestures` and `left`, seeds 5 and 6), one second gives the jitter at rest of the whole
    # recording, 0.33 and 0.16 mm; half a second 0.35 and 0.18 mm.
    lookahead_s: float = 1.0
    # The expected errors are means over this time, in s, before and after a frame. Of 0, 0.3, 0.5,
    # 0.7 and 1 s, on six real recordings (docs/fit.md), 0.5 and 0.7 have the highest correlation
    # with the true errors.
    lasting_s: float = 0.5


@dataclass(frozen=True)
class TrackSettings:
    """All tuned numbers of a ``Tracker``, besides those of its predictor."""

    start: StartSettings = StartSettings()
    follow: FollowSettings = FollowSettings()
    sides: SideSettings = SideSettings()
    present: PresentSettings = PresentSettings()
    size: SizeSettings = SizeSettings()
    smooth: SmoothSettings = SmoothSettings()
    later: LaterSettings = LaterSettings()
