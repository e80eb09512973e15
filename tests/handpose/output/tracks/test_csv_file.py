"""handpose/output/tracks/csv_file.py"""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handpose.output.tracks import csv_file
from handpose.output.tracks.writing import open_writer
from handpose.tracking.track import TrackedFrame, TrackHeader
from layers.hand.skeleton import load
from tests.support.made_tracks import any_hand, any_skeleton, any_track, header_of
from tests.support.tracked_hands import lost, present

HAND = header_of(load())


def written(path: Path, header: TrackHeader, frames: list[TrackedFrame]) -> list[dict[str, str]]:
    """The rows of the file, by column."""
    with open_writer(path, header) as writer:
        for frame in frames:
            writer.write(frame)
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    "header", [HAND, header_of(any_skeleton(2))], ids=["the hand", "another body"]
)
def test_a_row_per_frame_and_hand(here: Path, header: TrackHeader) -> None:
    frames = any_track(header, 3, 6)
    rows = iter(written(Path("a.csv"), header, frames))
    sk = header.skeleton
    for frame in frames:
        for hand in frame.hands:
            row = next(rows)
            given = (str(frame.number), str(hand.id), hand.hand, "")
            assert (row["number"], row["id"], row["hand"], row["lost"]) == given
            assert float(row["time_s"]) == pytest.approx(frame.time, abs=1e-6)
            joints = [
                [float(row[f"{name}_{axis}_mm"]) for axis in "xyz"] for name in sk.joint_names
            ]
            assert np.abs(np.array(joints) - hand.xyz).max() < 0.0051
            errors = [
                float(row[column]) for column in row if re.fullmatch("[a-z]+_error_mm", column)
            ]
            assert errors == pytest.approx(
                hand.finger_error_mm.tolist() if header is HAND else [], abs=0.0501
            )
            theta = sk.theta(hand.pose.inputs)
            for dof in set(sk.driven[sk.turns]):
                assert float(row[f"{sk.dof_names[dof]}_rad"]) == pytest.approx(theta[dof], abs=1e-5)
        for gone in frame.lost:
            row = next(rows)
            assert (row["id"], row["hand"], row["lost"]) == (str(gone.id), gone.hand, gone.reason)
            assert not any(list(row.values())[5:])
    assert next(rows, None) is None


def test_unknown_values_are_empty(here: Path, rng: np.random.Generator) -> None:
    """pandas reads them as NaN. A reason may contain commas and quotes."""
    hand = replace(any_hand(HAND, rng), confidence=np.nan, error_mm=np.nan)
    hand.finger_error_mm[1] = np.nan
    reason = 'it is "dark", 3 mm'
    before = TrackedFrame(0, 0, (replace(hand, id=2),))
    others = lost(1, "left", reason=reason), present(2, 0.5, 0.25, reason=reason)
    frame = TrackedFrame(1, 1, (hand, *others))
    _, seen, gone, there = written(Path("a.csv"), HAND, [before, frame])
    assert seen["confidence"] == seen["error_mm"] == seen["index_error_mm"] == ""
    assert gone["lost"] == reason
    assert list(there.values())[2:8] == ["2", "unknown", reason, "0.500", "0.2500", ""]


def test_a_hand_has_no_row_before_its_first_joints(here: Path, rng: np.random.Generator) -> None:
    hand = replace(any_hand(HAND, rng), id=1)
    other, same = present(0, 0.9, 0.1, reason="a cup"), present(1, 0.8, 0.1, reason="uncertain")
    frames = [
        TrackedFrame(0, 0.0, (other, same)),
        TrackedFrame(1, 1.0, (hand, other)),
        TrackedFrame(2, 2.0, (other, same)),
        TrackedFrame(3, 3.0, (other,)),
    ]
    rows = written(Path("a.csv"), HAND, frames)
    assert [row["id"] for row in rows] == ["", "1", "1", ""]
    assert [row["lost"] for row in rows] == ["a cup", "", "uncertain", "a cup"]


def test_a_frame_without_a_hand_has_a_row_with_the_reason(here: Path) -> None:
    """It is that of the most present hand."""
    places = present(0, 0.4, 0.1, reason="a cup"), present(1, 0.6, 0.1, reason="no pose")
    frames = [TrackedFrame(0, 0.0), TrackedFrame(1, 1.0, places)]
    none, best = (list(row.values()) for row in written(Path("a.csv"), HAND, frames))
    assert none[2:8] == ["", "", "no hand is seen", "", "", ""]
    assert best[2:8] == ["", "", "no pose", "0.600", "0.1000", ""]


def test_the_columns(here: Path) -> None:
    written(Path("a.csv"), HAND, [])
    assert (
        Path("a.csv")
        .read_text()
        .startswith(
            "number,time_s,id,hand,lost,presence,confidence,error_mm,"
            "thumb_error_mm,index_error_mm,middle_error_mm,ring_error_mm,little_error_mm,little_tip_x_mm,"
        )
    )


def test_a_carriage_return() -> None:
    """It is escaped, because it would begin another row."""
    assert csv_file.rows_of([["\r=a", "b"]]) == b"\\r=a,b\n"
