"""handpose/output/drawing/sheets.py"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.cameras import ICVL
from handpose.output.drawing import hands, sheets
from handpose.output.drawing.sheets import IMAGES_PER_PAGE, PAGES, ContactSheet
from handpose.output.drawing.strokes import Image
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of

SKELETON = skeletons.load()
CROPS = [np.full((128, 128), 1.0), np.full((128, 128), 0.5)]


def picture(value: int = 0) -> Image:
    return np.full((3, 4, 3), value % 256, np.uint8)


@given(frames=st.integers(1, 2000))
def test_the_moments_of_a_sheet_are_evenly_apart(frames: int) -> None:
    """Moments span the whole sequence for any number of frames; few pictures are kept, and
    few are drawn.
    """
    sheet = ContactSheet()
    drawn = []

    def draw() -> Image:
        drawn.append(n)
        return picture(n)

    for n in range(frames):
        sheet.add(n, draw)
        assert len(sheet._kept) <= PAGES * IMAGES_PER_PAGE
    times = sheet.times()
    assert len(times) == min(frames, IMAGES_PER_PAGE) and times[0] == 0
    gaps = np.diff(times)
    if len(gaps):
        assert gaps.min() >= 1 and gaps.max() <= 2 * gaps.min()
        assert frames - times[-1] <= gaps.max() + 1
    assert len(drawn) <= PAGES * IMAGES_PER_PAGE * (1 + np.log2(max(frames, 2)) / 2)


def test_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    received = {}
    draw = sheets.sheet
    monkeypatch.setattr(
        sheets, "sheet", lambda *given: received.update(given=given) or draw(*given)
    )
    sheet = ContactSheet()
    for n in range(3):
        sheet.add(n / 30, lambda n=n: np.full((300, 960, 3), n, np.uint8))
    assert sheet.page().shape == (150 + 22 + 16, 3 * (480 + 8) + 8, 3)
    images, columns, titles = received["given"]
    assert [image.shape for image in images] == [(150, 480, 3)] * 3
    assert [image[0, 0, 0] for image in images] == [0, 1, 2]
    assert columns == 4 and titles == ["0.00 s", "0.03 s", "0.07 s"]


def test_two_views(rng: np.random.Generator) -> None:
    """Each frame has two cells with a title each, the view on the crop and the view in space,
    below a legend.

    An annotation of other joints, such as ICVL's 16, is not drawn.
    """
    joints = kinematics_of(SKELETON).joints(rng.normal(0, 0.1, (2, len(SKELETON.initial))))
    centers = np.array([(250.0, 200, 700), (300, 220, 800)])
    cubes = [300.0, 250.0]
    titles = [("frame 0", "1 mm"), ("frame 7", "2 mm")]
    truths, others = joints[:, ::-1], joints[:, :16]
    for annotated, expected, at in ((truths, truths, centers), (others, [None] * 2, None)):
        drawn = hands.two_views(CROPS, joints, annotated, SKELETON, titles, at, ICVL, cubes)
        cells = []
        for n, (crop, hand, truth) in enumerate(zip(CROPS, joints, expected)):
            center = None if at is None else at[n]
            cells.append(hands.overlay(crop, hand, SKELETON, truth, center, cubes[n], ICVL, zoom=3))
            cells.append(hands.view_3d(hand, SKELETON, truth, size=384))
        page = sheets.sheet(cells, 6, ["frame 0", "1 mm", "frame 7", "2 mm"])
        legend, below = np.split(drawn, [len(drawn) - len(page)])
        assert np.array_equal(below, page)
        assert 0.02 < (legend < 100).any(axis=2).mean() < 0.5


def test_sheet() -> None:
    pictures = [
        np.full((60, 40), 10, np.uint8),
        np.full((30, 80, 3), 20, np.uint8),
        np.full((60, 80), 30, np.uint8),
    ]
    page = sheets.sheet(pictures, 2, ["one", "a title that is far too long for its cell", "three"])
    assert page.shape == (2 * (60 + 22 + 8) + 8, 2 * (80 + 8) + 8, 3)
    for value, picture in zip((10, 20, 30), pictures, strict=True):
        assert (page == value).all(axis=2).sum() >= picture.shape[0] * picture.shape[1]
    assert sheets.sheet(pictures[:1], 4).shape == (60 + 16, 40 + 16, 3)
