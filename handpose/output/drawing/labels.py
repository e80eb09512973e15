"""Colours, words and tags by which the hands of a frame are distinguished.

A tag is white text on a coloured background, kept within the image and apart from the other tags.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from handpose.output.drawing import strokes
from handpose.output.drawing.strokes import Colour, Image
from handpose.tracking.track import LostHand, TrackedHand

# Blue, green, red: dark enough for white letters on them, and for curves on white.
_COLOURS: tuple[Colour, ...] = (
    (190, 110, 25),
    (30, 95, 210),
    (60, 130, 40),
    (160, 55, 150),
    (60, 60, 60),
    (130, 130, 0),
)

HEIGHT = 22  # pixels
_WORDS = 0.55  # scale of text
_BESIDE = 6  # pixels of background left and right of the text


def colour_of(id: int) -> Colour:
    """The colour of the hand with this id."""
    return _COLOURS[id % len(_COLOURS)]


def percent(confidence: float) -> str:
    """``93%``; ``>99%`` for what would be rounded to 100%, since no estimate is certain."""
    return ">99%" if confidence >= 0.995 else f"{confidence:.0%}"


def spoken(hand: TrackedHand) -> str:
    """``right 93%``, ``right? 49%`` while the side is assumed; without the number if it was not measured."""
    side = hand.known_side or f"{hand.hand}?"
    return f"{side} {percent(hand.confidence)}" if math.isfinite(hand.confidence) else side


def spoken_loss(hand: LostHand, time: float) -> str:
    """``left hand lost 0.4 s: it left the image``."""
    return f"{f'{hand.hand} ' if hand.hand else ''}hand lost {max(time - hand.since, 0):.1f} s: {hand.reason}"


class Tags:
    """The tags of one image."""

    def __init__(self, canvas: Image) -> None:
        self._canvas = canvas
        self._taken: list[tuple[int, int, int]] = []  # left, right, top

    def add(self, words: str, left: float, bottom: float, colour: Colour, *, sure: bool = True) -> None:
        """Add a tag with its lower left corner as close to the point as possible, above rather than below.

        Unless it is ``sure``, the text is coloured on white.
        """
        height, width = self._canvas.shape[:2]
        room = width - 2 * _BESIDE
        scale = _WORDS * min(1.0, room / max(strokes.text_width(words, _WORDS), 1))
        wide = strokes.text_width(words, scale) + 2 * _BESIDE
        x = int(np.clip(left, 0, max(width - wide, 0)))
        wanted = int(np.clip(bottom - HEIGHT, 0, height - HEIGHT))
        places = sorted(range(wanted % HEIGHT, height - HEIGHT + 1, HEIGHT), key=lambda y: (abs(y - wanted), y))
        y = next((y for y in places if not self._hits(x, x + wide, y)), wanted)
        self._taken.append((x, x + wide, y))
        white = (255, 255, 255)
        cv2.rectangle(self._canvas, (x, y), (x + wide - 1, y + HEIGHT - 1), colour, -1)
        if not sure:
            cv2.rectangle(self._canvas, (x + 2, y + 2), (x + wide - 3, y + HEIGHT - 3), white, -1)
        strokes.text(self._canvas, words, np.array([x + _BESIDE, y + HEIGHT - 6]), white if sure else colour, scale)

    def _hits(self, left: int, right: int, top: int) -> bool:
        return any(left < end and right > start and abs(top - other) < HEIGHT for start, end, other in self._taken)
