"""From tracked frames to those that are reported: of a recording with what later frames show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import CapsuleModel
from handpose.tracking.lookahead import Lookahead
from handpose.tracking.sure_hands import SureHands
from handpose.tracking.track import TrackedFrame
from handpose.tracking.two_way_smoothing import TwoWaySmoothing

Ready = list[tuple[NDArray[np.float32], TrackedFrame]]


class Reporting:
    """The frames of a tracker without a minimum confidence, each with its depth image, as they are reported.

    model           of the hands' surfaces
    min_confidence  as for ``SureHands``, which come last, because decided sides and smoothing change the confidence
    at_once         report frames without waiting for later ones
    """

    def __init__(self, model: CapsuleModel, min_confidence: float, at_once: bool) -> None:
        self.sure_hands, self._at_once = SureHands(min_confidence), at_once
        self._lookahead = Lookahead[NDArray[np.float32]]()
        self._smoothing = TwoWaySmoothing[NDArray[np.float32]](model)

    def add(self, depth: NDArray[np.float32], frame: TrackedFrame) -> Ready:
        """Add the next frame. Returns those that are ready, in order."""
        return self._sure([(depth, frame)] if self._at_once else self._smoothing.add(self._lookahead.add(depth, frame)))

    def finish(self) -> Ready:
        """The frames that are still held, at the end of the recording."""
        return self._sure(self._smoothing.add(self._lookahead.finish()) + self._smoothing.finish())

    def _sure(self, ready: Ready) -> Ready:
        return [(depth, self.sure_hands(frame)) for depth, frame in ready]
