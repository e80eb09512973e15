"""handpose/drawing/contact_sheets.py"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.drawing import contact_sheets
from handpose.drawing.contact_sheets import PAGES, ContactSheet
from handpose.drawing.strokes import Image
from netlib.errors import DataError


def picture(value: int = 0) -> Image:
    return np.full((3, 4, 3), value % 256, np.uint8)


@given(frames=st.integers(1, 2000), columns=st.integers(1, 4), rows=st.integers(1, 4))
def test_moments_evenly_apart(frames: int, columns: int, rows: int) -> None:
    """From the first frame to nearly the last, whatever their number; few pictures are held, and few are drawn."""
    sheet, drawn = ContactSheet(columns, rows), []
    for n in range(frames):
        sheet.add(n, lambda n=n: drawn.append(n) or picture(n))
        assert len(sheet._kept) <= PAGES * columns * rows
    times = sheet.times()
    assert len(times) == min(frames, columns * rows) and times[0] == 0
    gaps = np.diff(times)
    if len(gaps):
        assert gaps.min() >= 1 and gaps.max() <= 2 * gaps.min()
        assert frames - times[-1] <= gaps.max() + 1
    assert len(drawn) <= PAGES * columns * rows * (1 + np.log2(max(frames, 2)) / 2)


def test_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each picture with its time in seconds above it, reduced to the width asked for."""
    told = {}
    monkeypatch.setattr(contact_sheets.strokes, "sheet", lambda *given: told.update(given=given))
    sheet = ContactSheet(2, 2, width=100)
    for n in range(3):
        sheet.add(n / 30, lambda n=n: np.full((150, 200, 3), n, np.uint8))
    sheet.page()
    images, columns, titles = told["given"]
    assert [image.shape for image in images] == [(75, 100, 3)] * 3 and [image[0, 0, 0] for image in images] == [0, 1, 2]
    assert columns == 2 and titles == ["0.00 s", "0.03 s", "0.07 s"]


def test_a_page_can_be_drawn() -> None:
    """Of as many pictures as there are."""
    sheet = ContactSheet(2, 2)
    sheet.add(0.0, picture)
    assert sheet.page().shape == (3 + 22 + 16, 4 + 16, 3)


def test_mistakes() -> None:
    """No places, no pictures."""
    with pytest.raises(DataError, match="0 columns, 3 rows"):
        ContactSheet(0, 3)
    with pytest.raises(DataError, match="0 pictures"):
        ContactSheet().page()
