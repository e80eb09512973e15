"""Curves of the confidence of each hand over the last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from handpose.drawing import strokes
from handpose.drawing.labels import colour_of, spoken
from handpose.drawing.strokes import Colour, Image
from handpose.track_files.track import TrackedFrame
from netlib.blob import Array

SECONDS = 3.0
_GRID: Colour = (225, 225, 225)
_INK: Colour = (110, 110, 110)
_LEFT, _RIGHT, _ABOVE, _BELOW = 56, 130, 12, 24  # margins in pixels, for labels
_ROW = 20  # line height in pixels
_WORDS = 0.42  # scale of text


class ConfidenceCurves:
    """A strip of curves; the frames of the last seconds are remembered."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, dict[int, float]]] = deque()

    def see(self, frame: TrackedFrame) -> None:
        """Add a frame."""
        self._seen.append((frame.time, {hand.id: hand.confidence for hand in frame.hands}))
        while self._seen[0][0] < frame.time - SECONDS:
            self._seen.popleft()

    def picture(self, frame: TrackedFrame, width: int, height: int) -> Image:
        """The strip (height, width, 3) up to the last frame seen. Without a confidence there is no curve."""
        canvas = np.full((height, width, 3), 255, dtype=np.uint8)
        right, bottom = width - _RIGHT, height - _BELOW

        def place(time: float, confidence: float) -> Array:
            x = right - (frame.time - time) / SECONDS * (right - _LEFT)
            return np.array([x, bottom - confidence * (bottom - _ABOVE)])

        for level in (0.0, 0.5, 1.0):
            start = place(frame.time - SECONDS, level)
            strokes.line(canvas, start, place(frame.time, level), _GRID, 1)
            words = f"{level:.0%}"
            strokes.text(canvas, words, start + (-8 - strokes.text_width(words, _WORDS), 5), _INK, _WORDS)
        for back in np.arange(SECONDS + 1):
            start = place(frame.time - back, 0)
            strokes.line(canvas, start, place(frame.time - back, 1), _GRID, 1)
            words = f"-{back:.0f} s" if back else "now"
            strokes.text(canvas, words, start + (-strokes.text_width(words, _WORDS) // 2, 16), _INK, _WORDS)
        for id, run in self._runs():
            strokes.lines(canvas, np.array([place(*point) for point in run]), colour_of(id), 2)
        now = [(hand.id, spoken(hand.hand, hand.confidence)) for hand in frame.hands]
        now += [(lost.id, f"{lost.hand} lost") for lost in frame.lost]
        for row, (id, words) in enumerate(sorted(now)):
            strokes.text(canvas, words, np.array([right + 14, 20 + _ROW * row]), colour_of(id), 0.5)
        return canvas

    def _runs(self) -> Iterator[tuple[int, list[tuple[float, float]]]]:
        """The runs of consecutive frames of each hand: id, and (time, confidence) of each frame."""
        open_runs: dict[int, list[tuple[float, float]]] = {}
        for time, hands in self._seen:
            known = {id: confidence for id, confidence in hands.items() if np.isfinite(confidence)}
            for id in [id for id in open_runs if id not in known]:
                yield id, open_runs.pop(id)
            for id, confidence in known.items():
                open_runs.setdefault(id, []).append((time, confidence))
        yield from open_runs.items()
