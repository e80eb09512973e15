"""The hands of tracked frames that are sure enough to be reported."""

from __future__ import annotations

from handpose.body.sides import Side
from handpose.tracking.reasons import uncertain
from handpose.tracking.track import PresentHand, TrackedFrame


class SureHands:
    """Takes hands below a minimum confidence out of the frames of a track, in their order; the tracker follows them on.

    Such a hand is present, without its joints; it is listed as lost later only if its joints were given before. A hand
    whose confidence is unknown is given.

    frames  number of frames with a hand that was taken out
    """

    def __init__(self, min_confidence: float) -> None:
        self.min_confidence, self.frames = min_confidence, 0
        self._reported: dict[int, tuple[float, Side | None]] = {}  # time in s, when a hand was given last, and its side

    @property
    def note(self) -> str:
        """How often a hand was taken out, as text; empty if never."""
        below = f"{self.frames} frames have a hand with a confidence below {self.min_confidence:.0%}"
        return f"{below}, whose joints are not given (--min-confidence)" if self.frames else ""

    def __call__(self, frame: TrackedFrame) -> TrackedFrame:
        """The frame with the hands that are sure enough."""
        if not self.min_confidence:
            return frame
        hands, present = [], list(frame.present)
        for hand in frame.hands:
            _, side = self._reported.get(hand.id, (None, None))
            if not hand.confidence < self.min_confidence:
                hands.append(hand)
                self._reported[hand.id] = frame.time, hand.known_side or side
            else:
                if hand.id in self._reported:
                    self._reported[hand.id] = frame.time, hand.known_side or side
                x, y, z = hand.palm_mm.tolist()
                present.append(PresentHand(hand.id, hand.known_side or side, hand.presence, hand.confidence, (x, y, z),
                                           uncertain(hand.confidence)))
        self.frames += len(hands) < len(frame.hands)
        lost = [one._replace(since=self._reported[one.id][0]) for one in frame.lost if one.id in self._reported]
        return TrackedFrame(frame.number, frame.time, tuple(hands), tuple(lost), tuple(present))
