"""handpose/output/tracks/joint_values.py: other joint formats in track files"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

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


@pytest.mark.parametrize("ending", ["json", "jsonl"])
@pytest.mark.parametrize("name", FORMATS)
def test_json(here: Path, name: FormatName, ending: str) -> None:
    """Every hand has the format in addition to the joints, the header describes it, and the track
    is read as before.
    """
    path = written(Path(f"a.{ending}"), name)
    found = (
        json.loads(path.read_text())
        if ending == "json"
        else json.loads(path.read_text().splitlines()[0])
    )
    assert found["joint_format"]["joints"] == list(FORMATS[name].joints)
    plain = written(Path(f"plain.{ending}"), None)
    assert repr(read_track(path).frames) == repr(read_track(plain).frames)
    assert "joint_format" not in plain.read_text() and "anatomical_deg" not in plain.read_text()
    first = (
        found if ending == "json" else {"frames": [json.loads(path.read_text().splitlines()[1])]}
    )
    hand, values = FRAMES[0].hands[1], first["frames"][0]["hands"][1]
    wanted = formatted(name, HEADER.skeleton, hand.hand, hand.xyz, HEADER.camera)
    key = {"mediapipe": "landmarks", "nyu": "positions_mm"}.get(name, "positions_m")
    assert np.allclose(
        values[name][key], wanted.landmarks if name == "mediapipe" else wanted.positions, atol=0.006
    )
    if name == "mediapipe":
        absolute = np.array(values[name]["world_landmarks"]) + values[name]["center_m"]
        assert np.allclose(absolute, wanted.positions, atol=2e-5)
        assert np.allclose(np.mean(values[name]["world_landmarks"], axis=0), 0, atol=1e-5)
    assert values["anatomical_deg"] == pytest.approx(
        anatomical_angles(HEADER.skeleton, hand.hand, hand.xyz), abs=0.006
    )


@pytest.mark.parametrize("name", FORMATS)
def test_csv(here: Path, name: FormatName) -> None:
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


def test_gestures(here: Path) -> None:
    """Each hand's gesture is written to JSON and, in the last columns, to CSV,
    with equal values.
    """
    reader = GestureReader(HEADER.skeleton)
    frames = [frame.with_gestures(reader) for frame in FRAMES]
    for name in ("a.json", "a.csv"):
        with open_writer(name, HEADER, gestures=True) as writer:
            for frame in frames:
                writer.write(frame)
    rows = [
        row for row in csv.DictReader(io.StringIO(Path("a.csv").read_text())) if not row["lost"]
    ]
    found = [
        hand["gesture"]
        for frame in json.loads(Path("a.json").read_text())["frames"]
        for hand in frame["hands"]
    ]
    gestures = [(row["gesture"], float(row["gesture_confidence"])) for row in rows]
    assert [(one["name"] or "", one["confidence"]) for one in found] == gestures
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
