"""handpose/drawing/tracks.py: curves of the confidence"""

from __future__ import annotations

import numpy as np

from handpose.drawing.labels import colour_of
from handpose.drawing.strokes import Image
from handpose.drawing.tracks import ConfidenceCurves
from handpose.track_files.track import LostHand, TrackedFrame
from tests.support.tracked_hands import tracked

PLOT = slice(56, 1280 - 130)


def frame(time: float, **confidence: float) -> TrackedFrame:
    """Of hands h1, h2, ... with these confidences."""
    told = tuple(tracked(id=int(name[1:]), confidence=value) for name, value in confidence.items())
    return TrackedFrame(round(time * 30), time, told)


def strip(*frames: TrackedFrame) -> Image:
    curves = ConfidenceCurves()
    for one in frames:
        curves.see(one)
    return curves.picture(frames[-1], 1280, 88)


def columns(picture: Image, id: int) -> list[int]:
    """In which columns there is a hand's curve."""
    return np.flatnonzero((picture[:, PLOT] == colour_of(id)).all(axis=2).any(axis=0)).tolist()


def says_a_name(picture: Image, id: int) -> bool:
    """Are there words in the hand's colour beside the curves? OpenCV versions smooth them differently."""
    return bool((np.abs(picture[:, 1280 - 130 :].astype(int) - colour_of(id)).max(axis=2) <= 10).any())


def test_the_surer_the_higher() -> None:
    """A curve per hand, in the hand's colour."""
    picture = strip(*(frame(n / 10, h1=0.9, h2=0.3) for n in range(20)))
    high, low = (np.nonzero((picture[:, PLOT] == colour_of(id)).all(axis=2))[0].mean() for id in (1, 2))
    assert 12 < high < low < 64
    np.testing.assert_allclose(low - high, 0.6 * 52, atol=1)


def test_a_gap_where_a_hand_was_lost() -> None:
    """Between one frame with the hand and the next one there is no line if frames without it lie between."""
    picture = strip(*(frame(n / 10, h1=0.5) for n in range(10)), *(frame(1 + n / 10) for n in range(10)),
                    *(frame(2 + n / 10, h1=0.5) for n in range(10)))  # fmt: skip
    found = columns(picture, 1)
    gaps = np.diff(found)
    width = 1280 - 56 - 130
    assert gaps.max() > 0.3 * width and np.sum(gaps > 1) == 1


def test_only_the_last_seconds() -> None:
    """What is older than three seconds is neither drawn nor kept."""
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
    """In its colour, beside the curves."""
    lost = TrackedFrame(1, 0.1, (), (LostHand(4, "left", 0.0, "left the image"),))
    assert says_a_name(strip(lost), 4)
