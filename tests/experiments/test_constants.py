"""experiments/constants.py"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.constants import (
    NOT_TUNED,
    Seen,
    _rows,
    cells_of,
    constants,
    followed,
    labels_of,
    numbers_of,
    set_constant,
    tuned,
)
from handpose.frames import camera_file
from handpose.frames.cameras import ICVL
from handpose.frames.recording import CameraInfo
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from netlib.errors import DataError


def test_constants_with_numbers_are_counted(tmp_path: Path) -> None:
    source = "A, B = 1, (2.0, 3)\nNAME = 'x'\nflag = 1\nIS = True\nC = A\nD = {'x': -4}\ndef f():\n    E = 5\n"
    (tmp_path / "some.py").write_text(source)
    assert numbers_of(tmp_path / "some.py") == ["A", "B", "D"]
    assert {"ENOUGH", "SURE"} <= set(constants()["tracking.hand_track"])


def test_few_numbers_are_tuned() -> None:
    """A new one replaces another; what is listed as not tuned exists."""
    assert all(set(names) <= set(constants()[module]) for module, names in NOT_TUNED.items())
    assert sum(map(len, tuned().values())) <= 105


@pytest.mark.parametrize(("text", "line"), [
    ("tracking.hand_track.NO=1", "no such constant"),
    ("SURE=1", "no such constant"),
    ("tracking.hand_track.SURE=x", "'x' is no number"),
    ("tracking.hand_track.SURE=1", "already loaded"),
])
def test_constants_that_cannot_be_set(text: str, line: str) -> None:
    import handpose.tracking.tracker  # noqa: F401

    with pytest.raises(DataError, match=line):
        set_constant(text)


def test_a_constant_is_set_before_the_tracker_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    from handpose.tracking import hand_track, present_hands

    monkeypatch.setattr(hand_track, "SURE", hand_track.SURE)
    monkeypatch.delitem(sys.modules, "handpose.tracking.tracker", raising=False)
    set_constant("tracking.hand_track.SURE=inf")
    assert np.inf == hand_track.SURE
    monkeypatch.setattr(present_hands, "LOOK", present_hands.LOOK)
    monkeypatch.setattr(hand_track, "LOOK", present_hands.LOOK)
    set_constant("tracking.present_hands.LOOK=1")
    assert hand_track.LOOK == present_hands.LOOK == 1, "it is loaded already, and imports the constant"


def test_the_columns() -> None:
    """Means over seeds; shares over all frames."""
    first, second = [Seen(10, 0.95, True), None], [Seen(40, 0.95, False), Seen(20, 0.5, True)]
    assert cells_of([first, second]) == ["20.00", "10.00", "30.00", "25.0%", "66.7%", "66.7%", "50.0%"]
    assert cells_of([[None]])[3:] == ["100.0%", "", "", ""]


def test_labels_that_are_none(tmp_path: Path) -> None:
    np.save(tmp_path / "l.npy", np.zeros((2, 4, 3)))
    with pytest.raises(DataError, match=r"l.npy: expected an .npy of joints \(frames, 5, 4, 3\) in mm"):
        labels_of(tmp_path / "l.npy")


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_recording_is_scored(tmp_path: Path, mirrored: bool) -> None:
    """A frame without a label is left out; labels are those of the joints that the tracker reports."""
    recording = SyntheticRecording(Script(0.8, {"right": (Act("rest", 1),)}), ICVL, rate=15, seed=2)
    labels = np.full((4, 5, 4, 3), np.nan)
    rows = _rows(recording.header.skeleton.joint_names)
    for n in range(4):
        cv2.imwrite(str(tmp_path / f"{n}.png"), recording.frame(n).depth.astype(np.uint16))
        if n != 1:
            labels[n] = 0
            labels[n, :, 1:] = recording.truth(n).hands[0].xyz[rows].mean(axis=2) * (1, -1, 1)
    camera_file.write(tmp_path / "camera.json", CameraInfo(ICVL))
    np.save(tmp_path / "labels.npy", labels)
    seen = list(followed(str(tmp_path), labels_of(tmp_path / "labels.npy"), 0, mirrored))
    assert len(seen) == 3 and all(one is not None and one.is_right_side and one.error_mm < 20 for one in seen[1:])
