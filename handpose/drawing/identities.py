"""Colours and labels that distinguish hands."""

from __future__ import annotations

import math

from handpose.drawing.strokes import Colour
from handpose.facts.sides import Side
from handpose.track_files.track import LostHand

# Blue, green, red: dark enough for white letters on them, and for curves on white.
_COLOURS: tuple[Colour, ...] = (
    (190, 110, 25),
    (30, 95, 210),
    (60, 130, 40),
    (160, 55, 150),
    (60, 60, 60),
    (130, 130, 0),
)


def colour_of(id: int) -> Colour:
    """The colour of the hand with this id."""
    return _COLOURS[id % len(_COLOURS)]


def spoken(hand: Side, confidence: float) -> str:
    """``right 93%``; without the number if the confidence was not measured."""
    return f"{hand} {percent(confidence)}" if math.isfinite(confidence) else hand


def percent(confidence: float) -> str:
    """``93%``; ``>99%`` for what would be rounded to 100%, since no estimate is certain."""
    return ">99%" if confidence >= 0.995 else f"{confidence:.0%}"


def spoken_loss(hand: LostHand, time: float) -> str:
    """``left hand lost 0.4 s: it left the image``."""
    return f"{hand.hand} hand lost {max(time - hand.since, 0):.1f} s: {hand.reason}"
