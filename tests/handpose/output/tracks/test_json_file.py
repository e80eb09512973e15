"""handpose/output/tracks/json_file.py: tracks are read as written, and interrupted
files are complete
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handpose.frames.cameras import Camera
from handpose.output.tracks.json_file import Track, read_track
from handpose.output.tracks.writing import open_writer
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader, joints_of
from layers.hand.skeleton import load
from netlib.errors import DataError, PrototxtError
from tests.support import json_schema
from tests.support.bad_input import bad_inputs, in_table
from tests.support.made_tracks import any_hand, any_skeleton, any_track, header_of
from tests.support.tracked_hands import facts, lost, present, with_pose

HAND = header_of(load())
both = pytest.mark.parametrize("layout", ["json", "jsonl"])


def written(path: Path, header: TrackHeader, frames: list[TrackedFrame]) -> Track:
    """The track, written in the layout of the suffix and read back."""
    with open_writer(path, header) as writer:
        for frame in frames:
            writer.write(frame)
    return read_track(path)


def check_same(track: Track, header: TrackHeader, frames: list[TrackedFrame]) -> None:
    """Assert equality to the digits of the file, also for the joints computed from
    angles and bones.
    """
    assert replace(track.header, skeleton=header.skeleton) == header
    assert track.header.skeleton.param == header.skeleton.param
    assert [frame.number for frame in track.frames] == [frame.number for frame in frames]
    assert [frame.time for frame in track.frames] == pytest.approx(
        [frame.time for frame in frames], abs=1e-6
    )
    for got, frame in zip(track.frames, frames):
        assert [(l.id, l.hand, l.reason) for l in got.lost] == [
            (l.id, l.hand, l.reason) for l in frame.lost
        ]
        assert [l.since for l in got.lost] == pytest.approx([l.since for l in frame.lost], abs=1e-6)
        for got_hand, hand in zip(got.hands, frame.hands, strict=True):
            check_same_hand(got_hand, hand, header.unit_mm)


def check_same_hand(got: TrackedHand, hand: TrackedHand, unit_mm: float) -> None:
    """Assert that a hand was read as written, to the digits of the file."""
    pose = got.pose
    assert (got.id, got.hand, pose.cube_mm) == (hand.id, hand.hand, hand.pose.cube_mm)
    sure = got.confidence, got.error_mm
    assert sure == pytest.approx((hand.confidence, hand.error_mm), abs=0.006, nan_ok=True)
    assert np.abs(pose.xyz - hand.pose.xyz).max() <= 0.00501
    assert np.abs(pose.origin_mm - hand.pose.origin_mm).max() <= 5e-4
    assert np.abs(pose.center_uvd - hand.pose.center_uvd).max() <= 5e-4
    assert np.abs(pose.bones - hand.pose.bones).max() <= 5e-6
    assert np.abs(got.finger_error_mm - hand.finger_error_mm).max() <= 0.0501
    again = joints_of(pose.skeleton, unit_mm, pose.side, pose.inputs, pose.bones, pose.origin_mm)
    assert np.abs(again - hand.xyz).max() < 0.05


@both
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_any_written_track_is_restored_by_reading(
    tmp_path_factory: pytest.TempPathFactory, layout: str, seed: int
) -> None:
    """Pose, bones and joints of both hands, and lost hands, for any body."""
    header = header_of(any_skeleton(seed), unit_mm=100.0)
    frames = any_track(header, seed)
    path = tmp_path_factory.mktemp("track") / f"a.{layout}"
    check_same(written(path, header, frames), header, frames)
    first, *lines = path.read_text().splitlines()
    if layout == "json":
        assert not json_schema.faults(json.loads(path.read_text()))
    else:
        assert not json_schema.faults(json.loads(first), "header")
        assert not any(json_schema.faults(json.loads(line), "frame") for line in lines)


@both
def test_the_packaged_hand(here: Path, layout: str) -> None:
    """The packaged hand is restored with its surface; bones are written only when they change."""
    frames = any_track(HAND, 3, 8)
    track = written(f"a.{layout}", HAND, frames)
    check_same(track, HAND, frames)
    assert not track.cut
    # two hands whose bones change once
    assert Path(f"a.{layout}").read_text().count("bones_mm") == 4


def test_keys_and_units(here: Path, rng: np.random.Generator) -> None:
    """Keys and units are as documented; unknown values are null."""
    hand = replace(any_hand(HAND, rng), confidence=np.nan, error_mm=float("nan"))
    written("a.json", HAND, [TrackedFrame(7, 0.25, (hand,))])
    found = json.loads(Path("a.json").read_text())
    body, (frame,) = found["skeleton"], found["frames"]
    assert not json_schema.faults(found)
    assert found["camera"]["fx"] == 588.03
    assert found["complete"] is True
    assert body["joints"] == HAND.skeleton.joint_names
    assert ["index_dip", "index_tip"] in body["bones"]
    assert len(body["angles"]) == 23  # 3 of the palm, 4 of each of four fingers, 4 of the thumb
    assert body["angles"][0] == {"name": "palm_rot_x", "lower": None, "upper": None}
    assert body["angles"][3]["upper"] == pytest.approx(0.968701 + 0.117380)
    assert (frame["number"], frame["time_s"]) == (7, 0.25)
    (got,) = frame["hands"]
    assert got["confidence"] is got["error_mm"] is None
    fingers = dict(zip(("thumb", "index", "middle", "ring", "little"), hand.finger_error_mm))
    assert got["finger_error_mm"] == pytest.approx(fingers, abs=0.0501)
    theta = HAND.skeleton.theta(hand.pose.inputs)
    assert got["angles_rad"]["index_dip_rot_x"] == pytest.approx(theta[46], abs=1e-5)
    assert got["translations_mm"]["palm_x"] == pytest.approx(theta[0] * 150, abs=1e-3)
    assert np.allclose(got["positions_mm"], hand.xyz, atol=0.0051)


def test_values_that_a_hand_may_lack(here: Path, rng: np.random.Generator) -> None:
    """Joints before smoothing are of smoothed hands only; errors of fingers may be null, or absent
    in older tracks.
    """
    hand = any_hand(HAND, rng)
    full = with_pose(hand, raw_xyz=hand.xyz + 7.125)
    full = replace(full, finger_error_mm=np.array([7, np.nan, 8, 9, 10]))
    written("a.json", HAND, [TrackedFrame(7, 0.25, (full,)), TrackedFrame(8, 0.5, (hand,))])
    found = json.loads(Path("a.json").read_text())
    assert not json_schema.faults(found)
    (one,), (other,) = (frame["hands"] for frame in found["frames"])
    assert one.pop("finger_error_mm") == {
        "thumb": 7,
        "index": None,
        "middle": 8,
        "ring": 9,
        "little": 10,
    }
    assert "raw_positions_mm" not in other
    Path("older.json").write_text(json.dumps(found))
    for name, errors in (("a", [7, np.nan, 8, 9, 10]), ("older", [np.nan] * 5)):
        first, second = (frame.hands[0] for frame in read_track(f"{name}.json").frames)
        np.testing.assert_array_equal(first.finger_error_mm, errors)
        assert np.allclose(first.pose.raw_xyz, full.pose.raw_xyz, atol=0.0051)
        assert second.pose.raw_xyz is None


@both
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), smoothed=st.booleans())
def test_a_track_that_was_read_is_written_as_before(
    tmp_path_factory: pytest.TempPathFactory, layout: str, seed: int, smoothed: bool
) -> None:
    """The whole header, and every value of hands with and without joints, of an undecided
    side, and lost.
    """
    folder, rng = tmp_path_factory.mktemp("track"), np.random.default_rng(seed)
    camera = Camera("own", *rng.uniform(100, 900, 4), 640, 480, min_range_mm=rng.uniform(0, 300))
    header = replace(header_of(any_skeleton(seed), 100.0), camera=camera, smoothed=smoothed)
    frames = any_track(header, seed)
    undecided = replace(any_hand(header, rng, 7), side_confidence=0.625, presence=0.5)
    if smoothed:
        undecided = with_pose(undecided, raw_xyz=undecided.xyz + 1)
    place = present(8, 0.5, 0.125, place=(1.5, 2.5, 600.0))
    frames.append(TrackedFrame(len(frames), 1.0, (undecided, place)))
    first, second = folder / f"a.{layout}", folder / f"b.{layout}"
    found = written(first, header, frames)
    written(second, found.header, found.frames)
    assert second.read_text() == first.read_text()
    assert found.header.camera.min_range_mm == pytest.approx(camera.min_range_mm, abs=1e-6)


def test_a_track_without_the_minimum_range(here: Path) -> None:
    """Tracks of earlier programs have the default."""
    written("a.json", HAND, [])
    found = json.loads(Path("a.json").read_text())
    del found["camera"]["min_range_mm"]
    Path("a.json").write_text(json.dumps(found))
    assert read_track("a.json").header.camera == HAND.camera


@pytest.mark.parametrize("smoothed", [True, False])
def test_joints_before_smoothing_of_a_hand_without_joints(here: Path, smoothed: bool) -> None:
    """Null in smoothed tracks, as the joints themselves; not in others."""
    frame = TrackedFrame(0, 0.0, (present(8, 0.5, 0.125),))
    written("a.json", replace(HAND, smoothed=smoothed), [frame])
    found = json.loads(Path("a.json").read_text())
    assert not json_schema.faults(found)
    (hand,) = found["frames"][0]["hands"]
    assert hand["positions_mm"] is None
    assert hand.get("raw_positions_mm", "missing") == (None if smoothed else "missing")


def test_an_interruption_leaves_a_whole_document(here: Path) -> None:
    """After an interruption the document is complete and has a note."""
    frames = any_track(HAND, 1, 3)
    with pytest.raises(KeyboardInterrupt), open_writer("a.json", HAND) as writer:
        for frame in frames:
            writer.write(frame)
        raise KeyboardInterrupt
    track = read_track("a.json")
    check_same(track, HAND, frames)
    assert track.cut == "the tracker was stopped"


@both
def test_no_frame_at_all(here: Path, layout: str) -> None:
    assert written(f"a.{layout}", HAND, []).frames == []


def test_lines_that_are_cut(here: Path) -> None:
    """Complete lines are read and a truncated one is reported; a missing final line end
    does not matter.
    """
    frames = any_track(HAND, 1, 3)
    written("a.jsonl", HAND, frames)
    text = Path("a.jsonl").read_text()
    Path("a.jsonl").write_text(text[:-9])
    track = read_track("a.jsonl")
    check_same(Track(track.header, track.frames), HAND, frames[:2])
    assert track.cut.startswith("a.jsonl:4: the line is cut after ")
    Path("a.jsonl").write_text(text[:-1])
    check_same(read_track("a.jsonl"), HAND, frames)


def test_a_document_that_another_program_laid_out(here: Path) -> None:
    frames = any_track(HAND, 1, 2)
    written("a.json", HAND, frames)
    values = json.loads(Path("a.json").read_text())
    for indent in (None, 2):
        Path("b.json").write_text(json.dumps(values, indent=indent))
        check_same(read_track("b.json"), HAND, frames)


@bad_inputs(
    DataError,
    {
        **in_table(Path(__file__).with_name("track_mistakes.txt"), "...a.json: "),
        "dog": (
            ('dof { name: \\"palm_x', 'dog { name: \\"palm_x'),
            PrototxtError,
            "...a.json: 'skeleton' 'prototxt':3:1: error: unknown field 'dog' (did you mean 'dof'?)",
        ),
        "digits": (('"number":0', '"number":' + "1" * 5000), "...a.json: not whole JSON: ..."),
        "levels": (("{", "[" * 100_000), "...a.json: JSON of too many levels"),
    },
)
def test_invalid_tracks_are_rejected(here: Path, given: tuple[str, str], rejected: Any) -> None:
    """The error names the place and what was expected, on one line."""
    path = Path("a.json")
    written(path, HAND, any_track(HAND, 1, 2))
    text = path.read_text()
    assert given[0] in text
    path.write_text(text.replace(*given, 1))
    with rejected:
        read_track(path)


@both
def test_an_undecided_side(here: Path, layout: str, rng: np.random.Generator) -> None:
    """The side is null until it is decided, and the assumed one, of which the angles are, returns
    from the file.
    """
    hand = replace(any_hand(HAND, rng, hand="left"), side_confidence=0.75)
    frame = TrackedFrame(0, 0.0, (hand, lost(4, None), present(5, 0.4, 0.1)))
    track = written(f"a.{layout}", HAND, [frame])
    (found,) = track.frames
    (one,) = found.hands
    assert (one.hand, one.pose.side, one.known_side) == ("left", "left", None)
    assert one.side_confidence == 0.75
    assert facts(found.lost) == facts(frame.lost) and facts(found.present) == facts(frame.present)
    if layout == "json":
        assert not json_schema.faults(json.loads(Path("a.json").read_text()))
    assert '"hand": null' in Path(f"a.{layout}").read_text().replace('"hand":null', '"hand": null')


@both
def test_another_body_has_no_side(here: Path, layout: str, rng: np.random.Generator) -> None:
    """As predictions of people in frames; the side of a hand is missed."""
    header = replace(header_of(load("prototxt/body/person.prototxt")), smoothed=False)
    body = replace(any_hand(header, rng), hand=None)
    ((one,),) = (frame.hands for frame in written(f"a.{layout}", header, [frame_of(body)]).frames)
    assert (one.hand, one.pose.side, one.side_confidence) == (None, "right", 1.0)
    assert np.abs(one.pose.xyz - body.pose.xyz).max() <= 0.00501
    hand = replace(any_hand(HAND, rng), hand=None)
    with pytest.raises(DataError, match="'hands' 0: there is no 'assumed_hand'"):
        written(f"a.{layout}", HAND, [frame_of(hand)])


def frame_of(hand: TrackedHand) -> TrackedFrame:
    return TrackedFrame(0, 0.0, (hand,))
