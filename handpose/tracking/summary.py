"""Summary of a track: how long each hand was tracked, and how often it was lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from handpose.tracking.track import TrackedFrame, side_name
from layers.hand.skeleton import Skeleton

LENGTH_MM = 217.0  # from the wrist to the tip of the middle finger, of a hand of size 1
# Sizes of the hands of adults: 99% are between the first and the last. With right focal lengths the
# five real recordings of one hand have 0.74 to 0.85; 20% too small, 0.93 to 1.10 and a lower
# confidence; 25% too large, 0.66 to 0.76.
MIN_ADULT_SIZE, LARGE_SIZE, MAX_ADULT_SIZE = 0.70, 0.92, 1.0
SURE_PERCENT = 93  # per cent: a large hand with this confidence is no doubt
MIN_FRAMES = 15  # fewer give no size


@dataclass
class HandSummary:
    """One hand.

    hand     "right", "left" or "unknown", as in its last frame
    frames   number of frames with it
    size     of its bones, relative to the skeleton's, in its last frame
    losses   number of times it was lost
    longest  s, its longest loss
    confidences  histogram of its confidence in per cent
    """

    hand: str
    frames: int = 0
    size: float = 1.0
    losses: int = 0
    longest: float = 0.0
    confidences: NDArray[np.int_] = field(default_factory=lambda: np.zeros(101, np.int_))
    is_lost: bool = False

    @property
    def sure(self) -> str:
        """The median confidence, as text."""
        return f"{self.median}%" if self.confidences.any() else "unknown"

    @property
    def median(self) -> int:
        """The median confidence in per cent; 0 if it is unknown."""
        below = np.cumsum(self.confidences)
        return int(np.searchsorted(below, below[-1] / 2))

    @property
    def doubt(self) -> str:
        """Why the focal lengths may be wrong, or an empty string."""
        is_small = self.size < MIN_ADULT_SIZE
        is_large = self.size > MAX_ADULT_SIZE or (
            self.size > LARGE_SIZE and self.median < SURE_PERCENT
        )
        if self.frames < MIN_FRAMES or not (is_small or is_large):
            return ""
        length, focal = ("shorter", "large") if is_small else ("longer", "small")
        return (
            f"it has {LENGTH_MM * self.size:.0f} mm from the wrist to the tip of the middle finger, {length} than "
            f"most hands of adults; if the real one is not, the focal lengths are 20% or more too {focal}"
        )


class Summary:
    """The summary of the frames added so far."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._has_bone = skeleton.bones != 0
        self._bones = skeleton.bones[self._has_bone]
        self.frames = 0
        self.hands: dict[int, HandSummary] = {}
        # number of hands without a sure pose by reason, without its figures
        self.present: Counter[str] = Counter()
        self._first = self._last = 0.0

    @property
    def seconds(self) -> float:
        """Seconds from the first frame to the last."""
        return self._last - self._first

    def add(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        if not self.frames:
            self._first = frame.time
        self.frames += 1
        self._last = frame.time
        for hand in (*frame.hands, *frame.lost):
            own = self.hands.setdefault(hand.id, HandSummary(side_name(hand.known_side)))
            if hand.pose is None:
                own.losses += not own.is_lost
                own.longest = max(own.longest, frame.time - hand.since)
            else:
                own.hand = side_name(hand.known_side)
                own.frames += 1
                own.size = float(np.median(hand.pose.bones[self._has_bone] / self._bones))
            own.is_lost = hand.is_lost
            if np.isfinite(hand.confidence):
                own.confidences[round(100 * hand.confidence)] += 1
        self.present.update(hand.reason.partition(" (")[0] for hand in frame.present)

    @property
    def rows(self) -> list[list[str]]:
        """A table of the hands by their ids, as text, with a heading."""
        return [
            ["hand", "frames", "confidence", "size", "lost", "longest"],
            *(
                [
                    f"{id} {own.hand}",
                    str(own.frames),
                    own.sure,
                    f"{own.size:.3f}",
                    str(own.losses),
                    f"{own.longest:.1f} s",
                ]
                for id, own in sorted(self.hands.items())
            ),
        ]

    @property
    def doubts(self) -> list[str]:
        """Hands of a size that shows wrong focal lengths, one line each."""
        return [f"hand {id}: {own.doubt}" for id, own in sorted(self.hands.items()) if own.doubt]

    @property
    def nothing_found(self) -> str:
        """Why no hand was found, as text."""
        if not self.present:
            return "no hand was found: no place looked like one"
        reasons = "; ".join(f"{reason} ({number})" for reason, number in self.present.most_common())
        return f"no pose was found of the hands that were seen: {reasons}"
