"""tools/demo.py: depth frames, and a picture of the hands found in them."""

import functools
import json
import shlex
from pathlib import Path

import cv2
import numpy as np

from handpose.frames.cameras import NYU
from handpose.frames.images import read_frame
from handpose.frames.recording import CameraInfo
from tests.support import json_schema
from tests.support.running import run_tool
from tools import demo


def test_demo(here):
    """The demo writes two depth frames, a picture and the joints, and prints a command that
    runs as printed.
    """
    first, second = run_tool("demo --out", "my frames ö", "--frames", "2").out.splitlines()
    assert first.startswith("2 frames in ")
    assert first.endswith(f": {Path('my frames ö/hands.png')}")
    command = second.removeprefix("For your own camera: ")
    words = shlex.split(command)[2:]
    assert " ".join(words) == "my frames ö/frame_0.png --camera nyu --out my frames ö"
    done = run_tool("predict", *words)
    assert done.err == ""
    assert done.out.startswith("my frames ö/frame_0.png: ")
    depth = read_frame("my frames ö/frame_1.png", CameraInfo(NYU))
    assert depth.shape == (480, 640)
    assert 300 < np.median(depth[depth > 0]) < 3000
    assert cv2.imread("my frames ö/hands.png").shape[1] > 3 * 256
    document = json.loads(Path("my frames ö/hands.json").read_text())
    assert not json_schema.faults(document)
    assert [frame["image"] for frame in document["frames"]] == ["frame_0.png", "frame_1.png"]
    hands = [hand for frame in document["frames"] for hand in frame["hands"]]
    assert all(hand["true_error_mm"] < 20 for hand in hands)


def test_an_uncertain_hand_is_shown_without_joints(here, monkeypatch):
    """Its row has the crop and no joints, in the picture and in the JSON file."""
    monkeypatch.setattr(
        demo, "load_predictor", functools.partial(demo.load_predictor, min_confidence=1)
    )
    run_tool("demo --frames 1")
    document = json.loads(Path("demo/hands.json").read_text())
    assert not json_schema.faults(document)
    (frame,) = document["frames"]
    assert [hand["positions_mm"] for hand in frame["hands"]] == [None]
    assert frame["hands"][0]["reason"].startswith("the pose is uncertain (confidence ")
    crop, *others = np.array_split(cv2.imread("demo/hands.png")[40:], 3, axis=1)
    assert crop.min() == 0
    assert min(other[:, 16:].min() for other in others) == 255


def test_nowhere_to_write(tmp_path):
    (tmp_path / "file").touch()
    assert "expected a folder" in run_tool("demo --out", tmp_path / "file" / "d", status=1).err
