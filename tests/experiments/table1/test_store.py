"""experiments/table1/store.py"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.table1 import store
from handpose.fit.joints.angles import rotations
from layers.hand import skeleton
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.made_store import entry, shown


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """An entry, also with NaN, is read as written, in four digits; the same entry gives the same bytes."""
    one = replace(entry(error=20.00004, broken=float("nan")), seconds=12.5)
    path = store.write(tmp_path, one)
    assert path == tmp_path / "one_hand" / "ours_paper_seed1_4000.json" and path.stat().st_size < 10_000
    (found,) = store.read_all(tmp_path, "one_hand")
    assert found.key == one.key and found.subjects[0].error_14_mm == 20 and np.isnan(found.subjects[1].out_of_limits)
    assert np.array_equal(found.shown, one.shown) and found.seconds == 12.5 and found.machine == one.machine
    before = path.read_bytes()
    assert store.write(tmp_path, found).read_bytes() == before
    assert store.read_all(tmp_path, "many_hands") == []


def test_the_frames_that_are_drawn(tmp_path: Path) -> None:
    """The crops of the frames to draw are restored to half a grey level."""
    store.write_shown(tmp_path, "one_hand", shown())
    found = store.read_shown(tmp_path, "one_hand")
    assert found.numbers == [0, 1, 2, 3] and found.truth.shape == (4, 31, 3)
    assert np.abs(np.array(found.crops) - np.array(shown().crops)).max() <= 1 / 255 + 1e-6


WHOLE = "expected a whole number of at least 1"


@bad_inputs(DataError, {
    f"{old} -> {new}": ((old, new), f".../one_hand/ours_paper_seed1_4000.json: {line}") for old, new, line in (
        ('"error_mm": 21.0', '"error_mm": "21"', "'error_mm' is '21', expected a number"),
        ('"seed": 1', '"seed": 2', "holds what belongs to one_hand/ours_paper_seed2_4000.json; was it renamed?"),
        ("\n}\n", "\n", "not whole JSON: ..."),
        ('"subjects"', '"subject"', "there is no 'subjects'"),
        ('"error_mm": 21.0', '"error_mm": -5', "'error_mm' is -5, expected a number of at least 0"),
        ('"iterations": 4000', '"iterations": 0', f"'iterations' is 0, {WHOLE}"),
        ('"frames": 100', '"frames": 0', f"'subjects' 0: 'frames' is 0, {WHOLE}"),
        ('"within_40_mm": 0.5', '"within_40_mm": 9',
         "'subjects' 0: 'within_40_mm' is 9, expected a number of at least 0, at most 1"),
        ('"seed": 1', '"seed": 1, "seed": 1', "has 'seed' twice"))
})
def test_a_damaged_entry_is_one_line(tmp_path: Path, given: tuple[str, str], rejected: Any) -> None:
    """The error names the file and what is wrong with it, on one line."""
    path = store.write(tmp_path, entry())
    text = path.read_text()
    assert given[0] in text
    path.write_text(text.replace(*given, 1))
    with rejected:
        store.read_all(tmp_path, "one_hand")


CROP = re.compile(r'(?<="crop": ")[^"]*')


@bad_inputs(DataError, {
    "negative": (lambda found: replace(found, half_cube=-found.half_cube),
                 "...shown.json: 4 frames, half-cubes from -150 mm; expected 4, and half-cubes above 0"),
    "one more": (lambda found: replace(found, numbers=[*found.numbers, 1], crops=[*found.crops, found.crops[0]]),
                 "...shown.json: 5 frames, half-cubes from 150 mm; expected 4, and half-cubes above 0"),
    "?": "...shown.json: a crop is not whole",
    "no crop": ("", "...shown.json: a crop is not a picture"),
    "AAAA": "...shown.json: a crop is not a picture",
})
def test_other_frames_than_are_drawn(tmp_path: Path, given: Any, rejected: Any) -> None:
    """Half-cubes that are not positive, another number of frames, and a crop that is no picture raise errors."""
    store.write_shown(tmp_path, "one_hand", shown() if isinstance(given, str) else given(shown()))
    if isinstance(given, str):
        path = tmp_path / "one_hand" / store.WHERE
        path.write_text(CROP.sub(given, path.read_text(), count=1))
    with rejected:
        store.read_shown(tmp_path, "one_hand")


def test_entries_of_other_data(tmp_path: Path) -> None:
    """Entries made with different data raise an error."""
    store.write(tmp_path, entry())
    other = store.write(tmp_path, replace(entry(iterations=6000), data="synthetic_11111111"))
    with pytest.raises(DataError, match=f"^{other}: was made with the data 'synthetic_11111111'"):
        store.read_all(tmp_path, "one_hand")


def test_sizes_are_the_hand_s() -> None:
    """The numbers of joints and rotations used in checks are those of the hand."""
    hand = skeleton.load()
    assert len(hand.joint_names) == store.JOINTS and len(rotations(hand)) == store.ROTATIONS
