"""experiments/constants.py and experiments/finder.py: figures on labelled recordings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from experiments import constants
from experiments.constants import Seen, cells_of, followed, set_constants
from experiments.finder import (
    Answer,
    Labelled,
    calibration,
    judged,
    labels_of,
    recalls_of,
    recorded,
    reliability,
    things_taken_for_hands,
)
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.packaged import HAND_FINDER
from handpose.frames import camera_file
from handpose.frames.cameras import NYU, Camera
from handpose.frames.recording import CameraInfo
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.blob import Array
from netlib.errors import DataError
from tests.support.labelled_recordings import write_labelled
from tests.support.running import run_tool

PLACE = np.array([10.0, 20.0, 700.0])


def test_constants_with_numbers_are_counted(tmp_path: Path) -> None:
    source = "A, B = 1, (2.0, 3)\nNAME = 'x'\nflag = 1\nIS = True\nC = A\nD = {'x': -4}\ndef f():\n    E = 5\n"
    (tmp_path / "some.py").write_text(source)
    assert constants.numbers_of(tmp_path / "some.py") == ["A", "B", "D"]


def test_few_numbers_are_tuned() -> None:
    """A new one replaces another; what is listed as not tuned exists."""
    assert {"ENOUGH", "SURE"} <= set(constants.tuned()["tracking.hand_track"])
    assert all(
        set(names) <= set(constants.constants()[module])
        for module, names in constants.NOT_TUNED.items()
    )
    assert sum(map(len, constants.tuned().values())) <= 99


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("tracking.hand_track.NO=1", "no such constant"),
        ("tracking.hand_track.SURE=x", "'x' is no number"),
        ("tracking.smoothing.PLACE=1", "its value is more than a number"),
        ("estimate.finder.FOCAL_PX=1", "handpose/estimate/finder.py has used its value"),
        # as a default argument
        ("estimate.hand.MIN_PRESENCE=0.5", "handpose/estimate/.* has used its value"),
        ("tracking.hand_track.SURE=1", "already loaded"),
    ],
)
def test_constants_that_cannot_be_set(
    text: str, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "loaded" in line:
        import handpose.tracking.tracker  # noqa: F401
    else:
        monkeypatch.delitem(sys.modules, "handpose.tracking.tracker", raising=False)
    with pytest.raises(DataError, match=line):
        set_constants([text])


def test_constants_are_set_before_the_tracker_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in the modules that import them; others with a constant of the same name keep it."""
    from handpose.estimate import finder
    from handpose.scoring import published_predictions
    from handpose.tracking import hand_track, present_hands

    nearest = published_predictions.NEAREST_MM
    for module, name in (
        (hand_track, "SURE"),
        (present_hands, "LOOK"),
        (hand_track, "LOOK"),
        (finder, "NEAREST_MM"),
    ):
        monkeypatch.setattr(module, name, getattr(module, name))
    monkeypatch.delitem(sys.modules, "handpose.tracking.tracker", raising=False)
    set_constants(
        [
            "tracking.hand_track.SURE=inf",
            "tracking.present_hands.LOOK=1",
            "estimate.finder.NEAREST_MM=9",
        ]
    )
    assert np.inf == hand_track.SURE and hand_track.LOOK == present_hands.LOOK == 1
    assert finder.NEAREST_MM == 9 and nearest == published_predictions.NEAREST_MM


def test_the_columns() -> None:
    """Means over seeds; shares over all frames."""
    first, second = [Seen(10, 0.95, True), None], [Seen(40, 0.95, False), Seen(20, 0.5, True)]
    assert cells_of([first, second]) == [
        "20.00",
        "10.00",
        "30.00",
        "25.0%",
        "66.7%",
        "66.7%",
        "50.0%",
    ]
    assert cells_of([[None]])[3:] == ["100.0%", "", "", ""]


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_recording_is_scored(tmp_path: Path, mirrored: bool) -> None:
    """A frame without a label is left out; labels are those of the joints that the
    tracker reports.
    """
    source, labels = write_labelled(tmp_path, unlabelled=[1])
    seen = list(followed(str(source), constants.labels_of(labels), 0, mirrored))
    assert len(seen) == 3
    assert all(one is not None and one.is_right_side and one.error_mm < 20 for one in seen[1:])


def test_labels_of_another_recording(tmp_path: Path) -> None:
    source, path = write_labelled(tmp_path)
    labels = constants.labels_of(path)
    for others in (labels[1:], np.repeat(labels, 2, axis=0)):
        with pytest.raises(
            DataError, match=f"take: expected as many frames as labels, {len(others)}"
        ):
            list(followed(str(source), others, 0, False))


def hand(presence: float, off: float, right: float = 0.9) -> FoundHand:
    return FoundHand(presence, PLACE + (off, 0, 0), right, np.zeros((1, 1), bool))


def test_a_labelled_hand_is_found_once() -> None:
    """The next answer near it is false, and one near a doubtful hand is not counted."""
    frame = Labelled(np.zeros((480, 640)), NYU, [(PLACE, "left")], [PLACE + (500, 0, 0)])
    answers = judged(
        [hand(0.9, 70), hand(0.8, 10), hand(0.7, 300), hand(0.6, 450), hand(0.5, 0, 0.5)], frame
    )
    assert [(one.presence, one.true) for one in answers] == [
        (0.9, True),
        (0.8, False),
        (0.7, False),
        (0.5, False),
    ]
    assert answers[0] == Answer(0.9, True, "right", right_side=False, off_mm=70.0)


def test_recalls_at_numbers_of_false_hands() -> None:
    """Two frames, four hands: 1, 2 and 4 false ones are allowed."""
    true = [True, False, True, False, True, False, False, False, True]
    answers = [Answer(1 - n / 10, one) for n, one in enumerate(true)]
    recalls, threshold = recalls_of(answers, total=4, frames=2)
    assert recalls == [0.5, 0.75, 0.75] and threshold == pytest.approx(0.6)
    assert recalls_of([], 4, 2) == ([0, 0, 0], 2.0)


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


def test_the_packaged_finder_is_measured() -> None:
    done = run_tool(
        "experiments.__main__ finder", HAND_FINDER / "hand_finder.caffemodel.h5", "--scenes", "16"
    )
    head, drawn, other = done.out.splitlines()[-3:]
    assert head.startswith("frames of")
    for line, name in ((drawn, "test"), (other, "other")):
        found, count, _, _, recall, *_ = line.split()
        assert (found, count) == (name, "16") and float(recall.rstrip("%")) > 50


def test_presences_are_compared_with_what_was_there() -> None:
    sure = [Answer(0.85, n < 30) for n in range(40)]
    unsure = [Answer(0.25, n < 10) for n in range(40)]
    head, *rows = reliability({"one": sure, "two": unsure, "none": []})
    assert head == ["presence", "one", "two", "none"] and len(rows) == 10
    assert ["80% to 90%", "75% of 40", "", ""] in rows
    assert ["20% to 30%", "", "25% of 40", ""] in rows
    scale, shift = calibration([*sure, *unsure])
    for said, share in ((0.85, 0.75), (0.25, 0.25)):
        odds = np.exp(scale * np.log(said / (1 - said)) + shift)
        assert odds / (1 + odds) == pytest.approx(share)


def test_false_detections_are_counted_by_the_name_of_the_object() -> None:
    """A stand-in that finds a hand in the middle of each frame, and one far outside."""

    class Sees:
        def hands(self, depth: Array, camera: Camera, most: int) -> list[FoundHand]:
            middle = camera.unproject([80.0, 64.0, 500.0])
            return [FoundHand(0.9, middle, 0.5, depth > 0)]

    head, *rows = things_taken_for_hands(cast(Finder, Sees()), 3, 8)
    assert head == ["taken for a hand", "pixels", "times", "a frame"]
    assert sum(int(times) for _, _, times, _ in rows) == 8
    names = {*SceneGenerator(3).names} - {"hand"}
    assert {name for name, *_ in rows} <= names
    shares = [float(share.rstrip("%")) for _, share, *_ in rows]
    assert 0 < sum(shares) <= 100


def test_invalid_labels_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "x.npy").write_bytes(b"no array")
    np.save(tmp_path / "flat.npy", np.zeros(3))
    for name, message in (
        ("x", "not an array of numbers"),
        ("flat", r"\(3,\), expected joints \(frames, \.\.\., 3\)"),
    ):
        with pytest.raises(DataError, match=rf"{name}\.npy: {message}"):
            next(recorded("frames", {"left": tmp_path / f"{name}.npy"}, "all"))
    with pytest.raises(
        DataError, match=r"flat.npy: expected an .npy of joints \(frames, 5, 4, 3\) in mm"
    ):
        constants.labels_of(tmp_path / "flat.npy")
    with pytest.raises(
        DataError, match=r"'up=x\.npy', expected left=LABELS\.npy or right=LABELS\.npy"
    ):
        labels_of(["up=x.npy"])
