"""handpose/output/drawing/tracks.py: curves of the confidence"""

from __future__ import annotations

import numpy as np

from handpose.output.drawing.labels import colour_of
from handpose.output.drawing.strokes import Image
from handpose.output.drawing.tracks import ConfidenceCurves
from handpose.tracking.track import LostHand, TrackedFrame
from tests.support.tracked_hands import tracked

PLOT = slice(56, 1280 - 130)


def frame(time: float, **confidence: float) -> TrackedFrame:
    """A frame with hands h1, h2, ... of these confidences."""
    hands = tuple(tracked(id=int(name[1:]), confidence=value) for name, value in confidence.items())
    return TrackedFrame(round(time * 30), time, hands)


def strip(*frames: TrackedFrame) -> Image:
    curves = ConfidenceCurves()
    for one in frames:
        curves.see(one)
    return curves.picture(frames[-1], 1280, 88)


def columns(picture: Image, id: int) -> list[int]:
    """The columns that contain a hand's curve."""
    return np.flatnonzero((picture[:, PLOT] == colour_of(id)).all(axis=2).any(axis=0)).tolist()


def says_a_name(picture: Image, id: int) -> bool:
    """Whether text in the hand's colour is beside the curves; OpenCV versions smooth it differently."""
    return bool((np.abs(picture[:, 1280 - 130 :].astype(int) - colour_of(id)).max(axis=2) <= 10).any())


def test_the_surer_the_higher() -> None:
    """Each hand has a curve in its colour, higher for a higher confidence."""
    picture = strip(*(frame(n / 10, h1=0.9, h2=0.3) for n in range(20)))
    high, low = (np.nonzero((picture[:, PLOT] == colour_of(id)).all(axis=2))[0].mean() for id in (1, 2))
    assert 12 < high < low < 64
    np.testing.assert_allclose(low - high, 0.6 * 52, atol=1)


def test_a_gap_where_a_hand_was_lost() -> None:
    """Frames without the hand interrupt its curve."""
    picture = strip(*(frame(n / 10, h1=0.5) for n in range(10)), *(frame(1 + n / 10) for n in range(10)),
                    *(frame(2 + n / 10, h1=0.5) for n in range(10)))
    found = columns(picture, 1)
    gaps = np.diff(found)
    width = 1280 - 56 - 130
    assert gaps.max() > 0.3 * width and np.sum(gaps > 1) == 1


def test_only_the_last_seconds() -> None:
    """Frames older than three seconds are neither drawn nor kept."""
    curves = ConfidenceCurves()
    for n in range(1000):
        curves.see(frame(n / 10, h1=0.5))
    assert len(curves._seen) <= 32
    assert columns(curves.picture(frame(99.9, h1=0.5), 1280, 88), 1)[0] >= 0


def test_without_a_confidence_there_is_no_curve() -> None:
    """Without a confidence only the hand's name is drawn."""
    picture = strip(*(frame(n / 10, h1=np.nan) for n in range(20)))
    assert columns(picture, 1) == []
    assert says_a_name(picture, 1)


def test_a_lost_hand_is_named() -> None:
    """Its name is written in its colour, beside the curves."""
    lost = TrackedFrame(1, 0.1, (), (LostHand(4, "left", 0.0, "left the image"),))
    assert says_a_name(strip(lost), 4)
