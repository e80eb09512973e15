"""tools/track.py: from a recording to output files."""

from __future__ import annotations

import argparse
import itertools
import json
import re
import shutil
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.estimate.predictor import Predictor
from handpose.fit import depth_fit
from handpose.frames.cameras import ICVL
from handpose.frames.formats import open_recording
from handpose.frames.formats.stack import StackRecording
from handpose.frames.recording import DepthFrame
from handpose.output.drawing.tracks import Painter
from handpose.output.tracks.json_file import read_track
from handpose.tracking.later_frames import LaterFrames
from handpose.tracking.track import TrackedFrame
from handpose.tracking.tracker import Tracker, load_tracker
from netlib.errors import DataError
from tests.support import json_schema
from tests.support.running import run_tool
from tests.tools.conftest import COUNT
from tools import track

RAW = "--camera icvl --unit 1"  # required for a bare stack, besides --rate


@pytest.fixture(autouse=True)
def take(recorded: Path, here: Path) -> None:
    """Copy the recording to takes/take.npz in the working directory."""
    Path("takes").mkdir()
    shutil.copy(recorded / "take.npz", "takes/take.npz")


def files() -> list[str]:
    """Return the names of all files except the recordings."""
    return sorted(path.name for path in Path().iterdir() if path.name != "takes")


def stopped_at(monkeypatch: pytest.MonkeyPatch, number: int, stop: Any) -> None:
    """Call ``stop`` while this frame is tracked."""
    step = Tracker.step

    def interrupted(self: Tracker, frame: DepthFrame) -> Any:
        if frame.number == number:
            stop()
        return step(self, frame)

    monkeypatch.setattr(Tracker, "step", interrupted)


# ------------------------------------------------------------------------------------------ results


def test_default_outputs_have_the_smoothed_results() -> None:
    """By default a JSON file and a contact sheet, named after the source, have the results,
    smoothed both ways.
    """
    _, said, error = run_tool("track takes/take.npz")
    assert files() == ["take.json", "take.png"]
    found = read_track("take.json")
    with open_recording("takes/take.npz") as recording:
        tracker = load_tracker(recording.camera)
        later = LaterFrames[None](tracker.model)
        for frame in tracker.follow(recording):
            assert not later.add(None, frame)
        expected = [frame for _, frame in later.finish()]
    assert not found.cut
    assert found.header.smoothed
    assert found.header.camera == ICVL
    assert len(found.frames) == COUNT
    for one, other in zip(found.frames, expected):
        assert (one.number, [hand.id for hand in one.hands]) == (
            other.number,
            [hand.id for hand in other.hands],
        )
        for own, same in zip(one.hands, other.hands):
            assert_allclose(own.xyz, same.xyz, atol=0.006)
    assert cv2.imread("take.png") is not None
    assert error == ""
    lines = said.splitlines()
    assert lines[0] == f"takes/take.npz: {COUNT} frames, 320 x 240 pixels, 15 frames/s"
    assert [line for line in lines if line.startswith(f"{COUNT} frames of 0.3 s, ")]
    assert [line for line in lines if line.split()[:2] == ["0", "right"]]
    assert sorted(lines[-2:]) == ["wrote take.json", "wrote take.png"]


def test_json_lines_for_other_programs_go_to_stdout() -> None:
    """With --json - a header and a line per frame go to stdout, with other joints;
    messages go to stderr.
    """
    _, out, said = run_tool("track takes/take.npz --json - --csv takes/a.csv --joints mano")
    header, *frames = (json.loads(line) for line in out.splitlines())
    assert header["format"] == "handpose"
    assert header["source"] == "takes/take.npz"
    assert [frame["number"] for frame in frames] == list(range(COUNT))
    assert header["joint_format"]["name"] == "mano"
    assert len(frames[0]["hands"][0]["mano"]["positions_m"]) == 21
    assert "index1_x_m" in Path("takes/a.csv").read_text().splitlines()[0]
    assert not json_schema.faults(header, "header")
    assert not any(json_schema.faults(frame, "frame") for frame in frames)
    assert said.startswith("takes/take.npz: ")
    assert re.search(r"\d\.\d frames/s", said)  # one frame in three seconds is not 0
    assert "0 right" in said
    assert files() == []


def test_an_unknown_rate_is_reported() -> None:
    np.save("takes/wall.npy", np.full((3, 240, 320), 900, np.uint16))
    command = f"track takes/wall.npy {RAW} --json a.json"
    assert "rate unknown: 30 frames per second assumed" in run_tool(command).err
    assert "rate unknown" not in run_tool(f"{command} --rate 15").err


def test_options_reach_the_tracker() -> None:
    """--raw, --size and --frames are passed to the tracker."""
    run_tool("track takes/take.npz --json a.json --raw --size 1.1 --frames 3")
    found = read_track("a.json")
    assert not found.header.smoothed
    assert len(found.frames) == 3
    assert not found.cut
    assert files() == ["a.json"]
    bones = found.frames[-1].hands[0].pose.bones
    assert_allclose(bones, 1.1 * found.header.skeleton.bones, rtol=0.01, atol=1e-5)


@pytest.mark.parametrize(
    ("options", "expected"),
    [("", [0, 2, 4]), ("--min-confidence 0.4", [0, 4]), ("--min-confidence 0", [0, 1, 2, 3, 4, 5])],
)
def test_hands_below_the_minimum_confidence_are_written_without_joints(
    options: str, expected: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The confidence after the smoothing counts."""
    release = LaterFrames._release
    confidences = (0.5, 0.1, 0.3, 0.29, 0.9, 0.0)

    def with_confidence(frame: TrackedFrame) -> TrackedFrame:
        confidence = confidences[frame.number]
        return frame._replace(
            every=tuple(replace(one, confidence=confidence) for one in frame.every)
        )

    def doubtful(self: LaterFrames[Any], count: int) -> list[tuple[Any, TrackedFrame]]:
        return [(item, with_confidence(frame)) for item, frame in release(self, count)]

    monkeypatch.setattr(LaterFrames, "_release", doubtful)
    done = run_tool(f"track takes/take.npz --json a.json {options}")
    frames = read_track("a.json").frames
    without_joints = [n for n in range(COUNT) if n not in expected]
    assert [frame.number for frame in frames if frame.hands] == expected
    assert [frame.number for frame in frames if frame.present] == without_joints
    summary = f"{COUNT - len(expected)} frames have a hand with a confidence below"
    assert (summary in done.out) == (len(expected) < COUNT)


def test_the_summary_explains_why_no_hand_has_joints() -> None:
    done = run_tool("track takes/take.npz --json a.json --min-confidence 1")
    assert (
        f"no pose was found of the hands that were seen: the pose is uncertain ({COUNT})"
        in done.out
    )
    assert f"{COUNT} frames have a hand with a confidence below 100%" in done.out
    assert "(docs/camera.md#limits); --min-confidence 0 writes" in done.out
    assert not any(frame.hands for frame in read_track("a.json").frames)


def test_option_hand_restricts_the_tracked_hand() -> None:
    """Even if it is not visible."""
    run_tool("track takes/take.npz --json a.json --hand left --frames 2")
    assert {hand.hand for frame in read_track("a.json").frames for hand in frame.hands} <= {"left"}


@pytest.mark.parametrize("picture", ["--sheet a.png", "--video a.mp4"])
def test_pictures_show_the_gestures_of_the_json(
    picture: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw, labels = Painter.seen, []

    def seen(self: Painter, depth: Any, frame: TrackedFrame) -> Any:
        labels.append({hand.id: hand.gesture.name for hand in frame.hands})
        return draw(self, depth, frame)

    monkeypatch.setattr(Painter, "seen", seen)
    run_tool(f"track takes/take.npz --json a.json --gestures {picture}")
    frames = json.loads(Path("a.json").read_text())["frames"]
    assert labels == [
        {hand["id"]: hand["gesture"]["name"] or "" for hand in frame["hands"]} for frame in frames
    ]


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("takes/wave.bag", "wave"),
        ("takes/wave", "wave"),
        ("takes/wave/", "wave"),
        ("takes/*.png", "takes"),
        ("takes/left_*.png", "left"),
        ("realsense", "realsense"),
        ("takes/a b;c.npz", "a_b_c"),
        ("camera.npz", "camera_track"),
        (".", "here"),
        ("../here", "here"),
    ],
)
def test_outputs_are_named_after_the_source(
    source: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They never equal a camera file."""
    seen: list[argparse.Namespace] = []
    monkeypatch.setattr(track, "run", lambda args: seen.append(args) or 0)
    Path("here").mkdir()
    monkeypatch.chdir("here")
    run_tool("track", source)
    assert (seen[0].json, seen[0].sheet) == (f"{name}.json", f"{name}.png")


def test_look_draws_the_first_confident_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """--look tracks nothing: it draws the first hand that is sure enough, otherwise the first one,
    without joints.
    """
    predict, seen = Predictor.in_frame, itertools.count()

    def doubtful(self: Predictor, *args: Any) -> Any:
        self.min_confidence = 1.0 if next(seen) < 2 else 0.0
        return predict(self, *args)

    assert "frame 0: right hand, " in run_tool("track takes/take.npz --look look.png").out
    assert files() == ["look.png"]
    assert cv2.imread("look.png").shape[1] > 2 * 512
    done = run_tool("track takes/take.npz --look look.png --min-confidence 1")
    assert "frame 0: right hand, " in done.out
    assert "no joints below 100%" in done.out
    assert cv2.imread("look.png").shape[1] < 2 * 512
    monkeypatch.setattr(Predictor, "in_frame", doubtful)
    assert "frame 2: right hand, " in run_tool("track takes/take.npz --look look.png").out


# ------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_complete_files(
    number: int, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They end with the current frame, and the summary is printed."""
    stopped_at(monkeypatch, 3, lambda: signal.raise_signal(number))
    command = "track takes/take.npz --json a.json --csv a.csv"
    _, out, error = run_tool(command, status=status)
    found = read_track("a.json")
    assert found.cut
    assert [frame.number for frame in found.frames] == [0, 1, 2, 3]
    assert files() == ["a.csv", "a.json"]
    assert Path("a.csv").read_text().endswith("\n")
    assert error == "stopped after 4 frames\n"
    assert "4 frames of 0.2 s" in out
    assert "wrote a.json" in out


def test_the_error_of_a_frame_has_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """The files have the frames before it."""
    stopped_at(monkeypatch, 3, Mock(side_effect=DataError("no depth")))
    done = run_tool("track takes/take.npz --json a.json", status=1)
    assert done.err == "takes/take.npz: frame 3: no depth\n"
    assert read_track("a.json").cut
    assert len(read_track("a.json").frames) == 3


def test_a_truncated_source_is_tracked_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """All complete frames of a truncated source are tracked with a warning, and the file is not
    marked as cut.
    """
    frames_of = StackRecording.__iter__

    def until_the_cut(self: StackRecording) -> Iterator[DepthFrame]:
        yield from itertools.islice(frames_of(self), 3)
        self.cut = "damaged or cut after frame 2"

    monkeypatch.setattr(StackRecording, "__iter__", until_the_cut)
    done = run_tool("track takes/take.npz --json a.json")
    assert "warning: damaged or cut after frame 2" in done.err
    assert len(read_track("a.json").frames) == 3


def test_frames_without_a_hand_give_an_empty_track(rng: np.random.Generator) -> None:
    """With --look, the first frame is shown."""
    np.save("takes/wall.npy", rng.integers(1190, 1210, (3, 240, 320)).astype(np.uint16))
    assert "no hand was found: " in run_tool(f"track takes/wall.npy {RAW} --rate 15").out
    assert [(frame.hands, frame.lost) for frame in read_track("wall.json").frames] == [((), ())] * 3
    assert cv2.imread("wall.png") is not None
    np.save("takes/empty.npy", np.zeros((2, 240, 320), np.uint16))
    done = run_tool(f"track takes/empty.npy {RAW} --rate 15 --look look.png", status=1)
    assert done.err.splitlines()[-1] == (
        "takes/empty.npy: no hand in the first 2 frames; look.png shows the first one"
    )
    assert cv2.imread("look.png") is not None


def test_a_seed_repeats_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """The random starts have the given seed, and a second run gives the same track, to
    the last digit.
    """
    seeds, draw = [], depth_fit.drawn
    monkeypatch.setattr(depth_fit, "drawn", lambda *args: seeds.append(args[-1]) or draw(*args))
    documents = []
    for _ in range(2):
        run_tool("track takes/take.npz --seed 7 --json t.json")
        documents.append(json.loads(Path("t.json").read_text(encoding="utf-8")))
    assert documents[0] == documents[1]
    assert set(seeds) == {7}
