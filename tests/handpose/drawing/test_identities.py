"""handpose/drawing/identities.py"""

from __future__ import annotations

from handpose.drawing.identities import colour_of, percent, spoken, spoken_loss
from handpose.track_files.track import LostHand


def test_colours() -> None:
    """Hands that are seen together differ; white letters can be read on each."""
    colours = [colour_of(id) for id in range(6)]
    assert len(set(colours)) == 6 and colour_of(6) in colours
    assert all(0.11 * blue + 0.59 * green + 0.3 * red < 140 for blue, green, red in colours)


def test_words() -> None:
    """Whole per cent, none where nobody has measured; a loss with its time and its reason."""
    assert spoken("right", 0.934) == "right 93%"
    assert spoken("left", float("nan")) == "left"
    assert [percent(sure) for sure in (0.0, 0.994, 0.996, 1.0)] == ["0%", "99%", ">99%", ">99%"]
    assert spoken_loss(LostHand(1, "left", 2.0, "left the image"), 2.43) == "left hand lost 0.4 s: left the image"
