"""handpose/experiments/ledger.py"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_ledger import entry, shown

from handpose.experiments import ledger
from handpose.fitting.angles import rotations
from layers.hand import skeleton
from netlib.errors import DataError


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """With what is not known; numbers have four digits, and the same entry is the same bytes."""
    one = replace(entry(error=20.00004, broken=float("nan")), seconds=12.5)
    path = ledger.write(tmp_path, one)
    assert path == tmp_path / "one_hand" / "ours_paper_seed1_4000.json" and path.stat().st_size < 10_000
    (found,) = ledger.read_all(tmp_path, "one_hand")
    assert found.key == one.key and found.subjects[0].error_14_mm == 20 and np.isnan(found.subjects[1].out_of_limits)
    assert np.array_equal(found.shown, one.shown) and found.seconds == 12.5 and found.machine == one.machine
    before = path.read_bytes()
    assert ledger.write(tmp_path, found).read_bytes() == before
    assert ledger.read_all(tmp_path, "many_hands") == []


def test_the_frames_that_are_drawn(tmp_path: Path) -> None:
    """Their crops come back to half of a grey level."""
    ledger.write_shown(tmp_path, "one_hand", shown())
    found = ledger.read_shown(tmp_path, "one_hand")
    assert found.numbers == [0, 1, 2, 3] and found.truth.shape == (4, 31, 3)
    assert np.abs(np.array(found.crops) - np.array(shown().crops)).max() <= 1 / 255 + 1e-6


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"error_mm": 21.0', '"error_mm": "21"', "'error_mm' is '21', expected a number"),
        ('"seed": 1', '"seed": 2', "holds what belongs to one_hand/ours_paper_seed2_4000.json; was it renamed?"),
        ("\n}\n", "\n", "not whole JSON: "),
        ('"subjects"', '"subject"', "there is no 'subjects'"),
    ],
    ids=["number", "place", "cut", "field"],
)
def test_a_damaged_entry_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    """It names the file and what is wrong."""
    path = ledger.write(tmp_path, entry())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(DataError) as caught:
        ledger.read_all(tmp_path, "one_hand")
    assert str(caught.value).startswith(f"{path}: ") and message in str(caught.value) and "\n" not in str(caught.value)


def test_a_damaged_crop_is_one_line(tmp_path: Path) -> None:
    """Also one that is whole, but no picture."""
    ledger.write_shown(tmp_path, "one_hand", shown())
    path = tmp_path / "one_hand" / ledger.WHERE
    text = path.read_text()
    crop = text.split('"crop": "')[1].split('"')[0]
    for wrong in ("?", "", "AAAA"):
        path.write_text(text.replace(crop, wrong, 1))
        with pytest.raises(DataError, match="a crop is not"):
            ledger.read_shown(tmp_path, "one_hand")


def test_sizes_are_the_hand_s() -> None:
    """Those that the files are checked with."""
    hand = skeleton.load()
    assert len(hand.joint_names) == ledger.JOINTS and len(rotations(hand)) == ledger.ROTATIONS
