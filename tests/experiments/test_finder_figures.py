"""experiments/finder.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.finder import Answer, Labelled, drawn_scenes, judged, labels_of, other_scenes, recalls_of, recorded
from handpose.estimate.finder import FoundHand
from handpose.estimate.packaged import HAND_FINDER
from handpose.frames import camera_file
from handpose.frames.cameras import NYU
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.support.running import run_tool

PLACE = np.array([10.0, 20.0, 700.0])


def hand(presence: float, off: float, right: float = 0.9) -> FoundHand:
    return FoundHand(presence, PLACE + (off, 0, 0), right, np.zeros((1, 1), bool))


def test_a_labelled_hand_is_found_once() -> None:
    """The next answer near it is false, and one near a doubtful hand is not counted."""
    frame = Labelled(np.zeros((480, 640)), NYU, [(PLACE, "left")], [PLACE + (500, 0, 0)])
    answers = judged([hand(0.9, 70), hand(0.8, 10), hand(0.7, 300), hand(0.6, 450), hand(0.5, 0, 0.5)], frame)
    assert [(one.presence, one.true) for one in answers] == [(0.9, True), (0.8, False), (0.7, False), (0.5, False)]
    assert answers[0] == Answer(0.9, True, "right", right_side=False, off_mm=70.0)


def test_recalls_at_numbers_of_false_hands() -> None:
    """Two frames, four hands: 1, 2 and 4 false ones are allowed."""
    true = [True, False, True, False, True, False, False, False, True]
    answers = [Answer(1 - n / 10, one) for n, one in enumerate(true)]
    recalls, threshold = recalls_of(answers, total=4, frames=2)
    assert recalls == [0.5, 0.75, 0.75] and threshold == pytest.approx(0.6)
    assert recalls_of([], 4, 2) == ([0, 0, 0], 2.0)


def test_scenes_have_their_palms_where_their_cameras_see_them() -> None:
    for scenes in (drawn_scenes(3, 20), other_scenes(3, 6)):
        frames = list(scenes)
        pixels = [(frame, frame.camera.project(place)) for frame in frames for place, _ in frame.hands]
        assert len(pixels) >= 6 and {side for frame in frames for _, side in frame.hands} == {"left", "right"}
        near = []
        for frame, (u, v, z) in pixels:
            assert frame.depth.shape == (frame.camera.height, frame.camera.width)
            row, column = min(int(v), frame.camera.height - 1), min(int(u), frame.camera.width - 1)
            part = frame.depth[max(row - 9, 0) : row + 10, max(column - 9, 0) : column + 10]
            near.append(bool((np.abs(part - z) < 80).any()))
        assert np.mean(near) > 0.9


def test_the_labels_of_a_recording_and_its_half(tmp_path: Path) -> None:
    joints = np.full((3, 2, 3), np.nan)
    joints[1] = (10, -20, 700)
    np.save(tmp_path / "left.npy", joints)
    np.savez(tmp_path / "take.npz", depth=np.full((3, 480, 640), 700, np.uint16))
    camera_file.write(tmp_path / "camera.json", CameraInfo(NYU))
    labels = labels_of([f"left={tmp_path / 'left.npy'}"])
    for part, counts in (("all", [0, 1, 0]), ("even", [0, 0]), ("odd", [1])):
        frames = list(recorded(str(tmp_path / "take.npz"), labels, part))
        assert [len(frame.hands) for frame in frames] == counts
    place, side = frames[0].hands[0]
    assert side == "left" and place == pytest.approx(PLACE)


def test_labels_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"'up=x\.npy', expected left=LABELS\.npy or right=LABELS\.npy"):
        labels_of(["up=x.npy"])
    (tmp_path / "x.npy").write_bytes(b"no array")
    with pytest.raises(DataError, match=r"x\.npy: not an array of numbers"):
        next(recorded("frames", {"left": tmp_path / "x.npy"}, "all"))
    np.save(tmp_path / "flat.npy", np.zeros(3))
    with pytest.raises(DataError, match=r"flat\.npy: \(3,\), expected joints \(frames, \.\.\., 3\) in mm"):
        next(recorded("frames", {"left": tmp_path / "flat.npy"}, "all"))


def test_the_packaged_finder_is_measured() -> None:
    done = run_tool("experiments.__main__", "finder", HAND_FINDER / "hand_finder.caffemodel.h5", "--scenes", "16")
    head, drawn, other = done.out.splitlines()[-3:]
    assert head.startswith("frames of") and drawn.split()[:2] == ["test", "16"] and other.split()[:2] == ["other", "16"]
