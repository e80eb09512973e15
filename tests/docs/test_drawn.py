"""Figures are compared by their contents."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from docs.making.figures.drawn import as_svg, new_figure, shows_the_same
from docs.making.palette import DARK, DARK_AREAS, DATA
from netlib.files.paths import ROOT


def drawn(value: float = 2.0, word: str = "here", pixel: float = 1.0, title: str = "a") -> bytes:
    """Return a figure of a line, a word, a patch, points and an image, with a title above them."""
    from matplotlib.patches import Circle

    figure: Any = new_figure(2, 2)
    figure.suptitle(title)
    axes = figure.add_subplot()
    axes.plot([0, 1], [1, value])
    axes.text(0.5, 0.5, word)
    axes.add_patch(Circle((0, 0), 1))
    axes.scatter([0, 1], [0, 1])
    axes.imshow(np.full((4, 4), pixel))
    return as_svg(figure)


def test_the_same_figure_is_the_same() -> None:
    """The same figure is recognised; with one version of matplotlib it has the same bytes."""
    assert shows_the_same(drawn(), drawn())
    assert drawn() == drawn()


@pytest.mark.parametrize("change", [{"value": 2.01}, {"word": "there"}, {"pixel": 0.9}, {"title": "b"}], ids=str)
def test_another_value_or_word_is_another_figure(change: Any) -> None:
    """Other values, words, pixels or titles make another figure; values may differ by a thousandth of the largest."""
    assert not shows_the_same(drawn(), drawn(**change))
    assert shows_the_same(drawn(), drawn(value=2.0001))


def test_a_figure_is_dark_where_the_reader_prefers_it() -> None:
    """A figure has a style for dark pages, which replaces the palette's colours; so have all figures of the book."""
    style = drawn().decode().partition("<style>@media (prefers-color-scheme: dark) {")[2].partition("</style>")[0]
    assert f'[style*="fill: #ffffff"] {{fill: {DARK_AREAS["#ffffff"]} !important}}' in style
    assert f'[style*="stroke: {DATA}"] {{stroke: {DARK[DATA]} !important}}' in style
    for path in (ROOT / "docs" / "images" / "book").glob("*.svg"):
        assert style in path.read_text(encoding="utf-8"), f"{path.name}: remove it, then run make docs"


def test_a_file_that_says_nothing_is_another() -> None:
    """A file without a readable description, from another program or damaged, is another figure."""
    assert not shows_the_same(b"<svg/>", drawn())
