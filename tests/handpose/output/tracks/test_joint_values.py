"""handpose/output/tracks/joint_values.py: other joint formats in track files."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.body.gestures import GestureReader
from handpose.body.joint_formats.angles import anatomical_angles
from handpose.body.joint_formats.formats import FORMATS, FormatName, formatted
from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import open_writer
from layers.hand.skeleton import NYU_HAND, load
from netlib.errors import DataError
from tests.support.made_tracks import any_skeleton, any_track, header_of

HEADER = header_of(load(NYU_HAND.with_name("people.prototxt")))
FRAMES = any_track(HEADER, 1, 4)


def written(path: Path, joints: FormatName | None) -> Path:
    """The path of a file with the frames."""
    with open_writer(path, HEADER, joints=joints) as writer:
        for frame in FRAMES:
            writer.write(frame)
    return path


def header_and_first(path: Path) -> tuple[Any, Any]:
    """The header and the first frame of a file, as JSON values."""
    text = path.read_text()
    if path.suffix == ".json":
        whole = json.loads(text)
        return whole, whole["frames"][0]
    header, first, *_ = map(json.loads, text.splitlines())
    return header, first


@pytest.mark.parametrize("ending", ["json", "jsonl"])
@pytest.mark.parametrize("name", FORMATS)
def test_json_has_the_joint_format_in_addition(here: Path, name: FormatName, ending: str) -> None:
    """The header describes it, and every hand has the format's joints and the angles."""
    header, first = header_and_first(written(Path(f"a.{ending}"), name))
    assert header["joint_format"]["joints"] == list(FORMATS[name].joints)
    hand, values = FRAMES[0].hands[1], first["hands"][1]
    wanted = formatted(name, HEADER.skeleton, hand.hand, hand.xyz, HEADER.camera)
    own = values[name]
    if name == "mediapipe":
        assert np.allclose(own["landmarks"], wanted.landmarks, atol=0.006)
        absolute = np.array(own["world_landmarks"]) + own["center_m"]
        assert np.allclose(absolute, wanted.positions, atol=2e-5)
        assert np.allclose(np.mean(own["world_landmarks"], axis=0), 0, atol=1e-5)
    else:
        positions = own["positions_mm" if name == "nyu" else "positions_m"]
        assert np.allclose(positions, wanted.positions, atol=0.006)
    angles = anatomical_angles(HEADER.skeleton, hand.hand, hand.xyz)
    assert values["anatomical_deg"] == pytest.approx(angles, abs=0.006)


@pytest.mark.parametrize("ending", ["json", "jsonl"])
@pytest.mark.parametrize("name", FORMATS)
def test_a_track_with_a_joint_format_is_read_as_without(
    here: Path, name: FormatName, ending: str
) -> None:
    path = written(Path(f"a.{ending}"), name)
    plain = written(Path(f"plain.{ending}"), None)
    assert repr(read_track(path).frames) == repr(read_track(plain).frames)
    text = plain.read_text()
    assert "joint_format" not in text and "anatomical_deg" not in text


@pytest.mark.parametrize("name", FORMATS)
def test_csv_has_the_joint_format_in_place_of_joints(here: Path, name: FormatName) -> None:
    """The format's columns replace the joints and angles; a lost hand has an empty row."""
    rows = list(csv.DictReader(io.StringIO(written(Path("a.csv"), name).read_text())))
    assert len(rows) == sum(len(frame.hands) + len(frame.lost) for frame in FRAMES)
    hand, row = FRAMES[0].hands[1], rows[1]
    assert not any(column.endswith("_rad") for column in row) and None not in row
    wanted = formatted(name, HEADER.skeleton, hand.hand, hand.xyz, HEADER.camera)
    unit = FORMATS[name].unit
    joint = list(FORMATS[name].joints)[3]
    if name == "mediapipe":
        assert wanted.landmarks is not None
        place = [float(row[f"{joint}_{axis}"]) for axis in "xyz"]
        assert place == pytest.approx(wanted.landmarks[3], abs=1e-5)
        columns = [(f"{joint}_world_{axis}_m", f"center_{axis}_m") for axis in "xyz"]
        world = [float(row[offset]) + float(row[center]) for offset, center in columns]
        assert world == pytest.approx(wanted.positions[3], abs=2e-5)
    else:
        found = [float(row[f"{joint}_{axis}_{unit}"]) for axis in "xyz"]
        assert found == pytest.approx(wanted.positions[3], abs=0.006)
    angle = anatomical_angles(HEADER.skeleton, hand.hand, hand.xyz)["ring_pip_flexion"]
    assert float(row["ring_pip_flexion_deg"]) == pytest.approx(angle, abs=0.006)


def test_json_and_csv_have_the_same_gestures(here: Path) -> None:
    """Each hand's gesture is written to JSON and, in the last columns, to CSV,
    with equal values.
    """
    reader = GestureReader(HEADER.skeleton)
    frames = [frame.with_gestures(reader) for frame in FRAMES]
    for name in ("a.json", "a.csv"):
        with open_writer(name, HEADER, gestures=True) as writer:
            for frame in frames:
                writer.write(frame)
    rows = csv.DictReader(io.StringIO(Path("a.csv").read_text()))
    in_rows = [
        (row["gesture"], float(row["gesture_confidence"])) for row in rows if not row["lost"]
    ]
    written_frames = json.loads(Path("a.json").read_text())["frames"]
    found = [hand["gesture"] for frame in written_frames for hand in frame["hands"]]
    assert [(one["name"] or "", one["confidence"]) for one in found] == in_rows
    reader = GestureReader(HEADER.skeleton)
    hand = FRAMES[0].hands[0]
    wanted = reader.read(hand.id, hand.hand, hand.xyz, FRAMES[0].time)
    assert found[0]["confidence"] == pytest.approx(wanted.confidence, abs=1e-3)


def test_another_body_has_no_format(here: Path) -> None:
    header = header_of(any_skeleton(2))
    with (
        pytest.raises(
            DataError, match=r"no joint 'palm'; only hands have joints and angles of other formats$"
        ),
        open_writer("a.csv", header, joints="mano") as writer,
    ):
        writer.write(any_track(header, 3, 1)[0])
    assert not Path("a.csv").exists()
