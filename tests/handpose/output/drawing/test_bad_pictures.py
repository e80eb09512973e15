"""Pictures that cannot be drawn: what is given, and the line of the error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from handpose.output.drawing import hands, sheets
from handpose.output.drawing.sheets import ContactSheet
from handpose.output.drawing.tracks import Painter
from handpose.output.tracks.writing import open_writer
from handpose.tracking.track import TrackedFrame
from netlib.errors import DataError
from tests.handpose.output.drawing.test_hands import EMPTY, JOINTS, SKELETON
from tests.support.bad_input import bad_inputs
from tests.support.made_tracks import header_of
from tests.support.tracked_hands import HEADER

DEPTH = np.zeros((480, 640), np.float32)


@bad_inputs(
    DataError,
    {
        "no pictures": (
            lambda: sheets.sheet([], 1),
            "0 pictures in 1 columns, expected at least one of each",
        ),
        "an empty page": (
            lambda: ContactSheet().page(),
            "0 pictures in 4 columns, expected at least one of each",
        ),
        "14 joints": (
            lambda: hands.overlay(EMPTY, np.zeros((14, 3)), SKELETON),
            "joints of shape (14, 3), expected (31, 3) finite numbers",
        ),
        "no joints": (
            lambda: hands.view_3d(JOINTS * np.nan, SKELETON),
            "joints of shape (31, 3), expected (31, 3) finite numbers",
        ),
        "an oblong crop": (
            lambda: hands.overlay(np.ones((10, 20)), JOINTS, SKELETON),
            "crop of shape (10, 20), expected a square of depths",
        ),
        "another size": (
            lambda: Painter(HEADER).picture(DEPTH, TrackedFrame(30, 1.0, ())),
            "depth image of shape (480, 640), expected (120, 160) of camera 'small'",
        ),
        "a track as text": (
            lambda: open_writer("a.txt", header_of(SKELETON)),
            "a.txt: cannot write a track of this kind; "
            "expected a name in .json, .jsonl or .csv, or - for standard output",
        ),
    },
)
def test_invalid_pictures_and_tracks_are_rejected(
    given: Callable[[], object], rejected: Any
) -> None:
    with rejected:
        given()
