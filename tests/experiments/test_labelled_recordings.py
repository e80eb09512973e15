"""experiments/constants.py, finder.py and labelled_frames.py: figures on labelled recordings."""

from __future__ import annotations

import ast
import copy
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from experiments import constants
from experiments.constants import (
    Seen,
    Settings,
    cells_of,
    followed,
    numbers_of,
    parts_of,
    settings_of,
)
from experiments.finder import Answer, judged, recalls_of, reliability, things_taken_for_hands
from experiments.labelled_frames import Labelled, recorded
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.packaged import HAND_FINDER
from handpose.fit import settings as fit_settings
from handpose.fit.settings import JudgeSettings, Plan, Stage, Trials
from handpose.frames import camera_file
from handpose.frames.cameras import ICVL, NYU, Camera
from handpose.frames.recording import CameraInfo
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from handpose.synthetic.whole_scenes import SceneGenerator
from handpose.tracking import settings as track_settings
from handpose.tracking.later_frames import LaterFrames
from handpose.tracking.tracker import load_tracker
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.paths import ROOT
from tests.support.labelled_recordings import write_labelled
from tests.support.running import run_tool

PLACE = np.array([10.0, 20.0, 700.0])


def test_numbers_are_counted() -> None:
    """Those of groups and of tables one by one; a name is none."""
    plan = Plan("fast", 300, 6, Trials(4, 6, 4, Stage(15.0, 5), 2))
    found = numbers_of((plan, JudgeSettings(max_ratio=3), (1, 2)))
    assert found["0.trials.stage.robust"] == 15 and found["1.max_ratio"] == 3 and found["2.1"] == 2
    assert len(found) == 2 + 6 + 3 + 2


def test_few_numbers_are_tuned() -> None:
    """A new one replaces another."""
    assert len(numbers_of(Settings())) <= 107


def test_few_numbers_are_constants_of_modules() -> None:
    """One that is tuned is a setting instead."""
    statements = [
        statement
        for room in ("fit", "estimate", "tracking")
        for path in (ROOT / "handpose" / room).rglob("*.py")
        for statement in ast.parse(path.read_text(encoding="utf-8")).body
        if path.name != "settings.py" and isinstance(statement, ast.Assign)
    ]
    parts = [part for statement in statements for part in ast.walk(statement.value)]
    numbers = [part.value for part in parts if isinstance(part, ast.Constant)]
    assert sum(isinstance(number, (int, float)) for number in numbers) <= 115


@pytest.mark.parametrize("name", numbers_of(Settings()))
def test_a_number_is_set(name: str) -> None:
    """It alone; whole numbers remain whole."""
    before = numbers_of(Settings())
    value = before[name] + 1
    after = numbers_of(settings_of([f"{name}={value}"]))
    assert after == {**before, name: value} and type(after[name]) is type(before[name])


def test_several_numbers_are_set() -> None:
    settings = settings_of(["track.follow.sure=inf", "fit.search.accurate.trials.stage.robust=9"])
    assert settings.track.follow.sure == np.inf and settings.fit.search.accurate.trials is not None
    assert settings.fit.search.accurate.trials.stage == Stage(9.0, 5)
    assert settings.fit.search.fast is Settings().fit.search.fast
    assert settings.fit.objective == Settings().fit.objective


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "track.follow.shure=1",
            r"no such number \(did you mean 'track.follow.sure'\?\); python -m experiments constants",
        ),
        ("track.smooth.place=1", "no such number"),
        ("fit.search.fast.name=1", "no such number"),
        ("track.follow.sure=x", "'x' is no number"),
        ("track.follow.sure", "'' is no number"),
        ("fit.search.refining_iterations=1.5", "'1.5' is no whole number"),
    ],
)
def test_numbers_that_cannot_be_set(text: str, line: str) -> None:
    with pytest.raises(DataError, match=f"--set {text}: {line}"):
        settings_of([text])


# tables of which all entries are read together
WHOLE = {"track.smooth.place", "track.smooth.rotation", "track.smooth.others"}


def names_of(settings: object, name: str = "") -> dict[int, str]:
    """The names of all objects of settings, by their identity."""
    names = {id(settings): name}
    for key, part in parts_of(settings).items():
        if parts_of(part):
            names |= names_of(part, f"{name}.{key}" if name else key)
    return names


def test_every_number_is_read_from_the_settings_that_are_passed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """While two hands are tracked, of which one leaves, and which are covered and not read for a
    moment. Some numbers are set so that all rules apply in three seconds.
    """
    values = ["track.sides.clear=2", "track.sides.max_s=1.2", "track.size.poses=8"]
    given = copy.deepcopy(settings_of(["fit.steady.cost_factor=10", *values]))
    names, read, others = names_of(given), set(), set()
    classes = [
        kind
        for module in (fit_settings, track_settings)
        for kind in vars(module).values()
        if isinstance(kind, type) and kind.__module__ == module.__name__
    ]

    def recorded(self: object, key: str) -> object:
        if id(self) in names:
            read.add(f"{names[id(self)]}.{key}")
        elif type(self).__name__.endswith("Settings") and not key.startswith("__"):
            others.add(f"{type(self).__name__}.{key}")
        return object.__getattribute__(self, key)

    left = Act("rest", 1), Act("away", 1), Act("rest", 1)
    take = SyntheticRecording(
        Script(2.8, {"right": (Act("gestures", 3),), "left": left}), ICVL, rate=15, seed=2
    )
    for kind in classes:
        monkeypatch.setattr(kind, "__getattribute__", recorded)
    tracker = load_tracker(ICVL, fit_settings=given.fit, settings=given.track)
    whole, start = (
        LaterFrames[None](tracker.model, 0.3, settings=tracker.settings) for _ in range(2)
    )
    for frame in take:
        depth = np.array(frame.depth)
        if 20 <= frame.number < 24:
            depth[:, :140] = 0
        if 26 <= frame.number < 30:
            depth[100:] = 150
        found = tracker.step(frame._replace(depth=depth))
        whole.add(None, found)
        if frame.number < 3:
            start.add(None, found)
    whole.finish()
    start.finish()  # no side is decided yet
    monkeypatch.undo()
    unread = {name for name in numbers_of(given) if name not in read}
    unread -= {name for name in unread if name.rpartition(".")[0] in read & WHOLE}
    assert (unread, others) == (set(), set())


def test_the_columns() -> None:
    """Means over seeds; shares over all frames."""
    first, second = [Seen(10, 0.95, True), None], [Seen(40, 0.95, False), Seen(20, 0.5, True)]
    assert [*cells_of([first, second]).values()] == [
        "20.00",
        "10.00",
        "30.00",
        "25.0%",
        "66.7%",
        "66.7%",
        "50.0%",
    ]
    assert [*cells_of([[None]]).values()][3:] == ["100.0%", "", "", ""]


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_recording_is_scored(tmp_path: Path, mirrored: bool) -> None:
    """A frame without a label is left out; labels are those of the joints that the
    tracker reports.
    """
    source, labels = write_labelled(tmp_path, unlabelled=[1])
    seen = list(followed(str(source), constants.labels_of(labels), 0, mirrored, Settings()))
    assert len(seen) == 3
    assert all(one is not None and one.is_right_side and one.error_mm < 20 for one in seen[1:])


@pytest.mark.parametrize(
    "text",
    ["track.smooth.place.min_hz=0.01", "fit.search.step_factor=1", "fit.support.tolerance_mm=1"],
)
def test_other_numbers_give_other_hands(tmp_path: Path, text: str) -> None:
    source, path = write_labelled(tmp_path)
    before, after = (
        list(followed(str(source), constants.labels_of(path), 0, False, settings))
        for settings in (Settings(), settings_of([text]))
    )
    assert before != after and len(before) == len(after)


def test_labels_of_another_recording(tmp_path: Path) -> None:
    source, path = write_labelled(tmp_path)
    labels = constants.labels_of(path)
    for others in (labels[1:], np.repeat(labels, 2, axis=0)):
        with pytest.raises(
            DataError, match=f"take: expected as many frames as labels, {len(others)}"
        ):
            list(followed(str(source), others, 0, False, Settings()))


def hand(presence: float, off: float) -> FoundHand:
    return FoundHand(presence, PLACE + (off, 0, 0), np.zeros((1, 1), bool))


def test_a_labelled_hand_is_found_once() -> None:
    """The next answer near it is false, and one near a doubtful hand is not counted."""
    frame = Labelled(np.zeros((480, 640)), NYU, [PLACE], [PLACE + (500, 0, 0)])
    found = [hand(0.9, 70), hand(0.8, 10), hand(0.7, 300), hand(0.6, 450), hand(0.5, 0)]
    answers = judged(found, frame)
    assert [(one.presence, one.true) for one in answers] == [
        (0.9, True),
        (0.8, False),
        (0.7, False),
        (0.5, False),
    ]
    assert answers[0] == Answer(0.9, True, off_mm=70.0)


def test_recalls_at_numbers_of_false_hands() -> None:
    """Two frames, four hands: 1, 2 and 4 false ones are allowed."""
    true = [True, False, True, False, True, False, False, False, True]
    answers = [Answer(1 - n / 10, one) for n, one in enumerate(true)]
    recalls, threshold = recalls_of(answers, hands=4, frames=2)
    assert recalls == [0.5, 0.75, 0.75] and threshold == pytest.approx(0.6)
    assert recalls_of([], 4, 2) == ([0, 0, 0], 2.0)


def test_the_labels_of_a_recording(tmp_path: Path) -> None:
    joints = np.full((3, 2, 3), np.nan)
    joints[1] = (10, -20, 700)
    np.save(tmp_path / "left.npy", joints)
    np.savez(tmp_path / "take.npz", depth=np.full((3, 480, 640), 700, np.uint16))
    camera_file.write(tmp_path / "camera.json", CameraInfo(NYU))
    frames = list(recorded(str(tmp_path / "take.npz"), [str(tmp_path / "left.npy")]))
    assert [len(frame.hands) for frame in frames] == [0, 1, 0]
    assert frames[1].hands[0] == pytest.approx(PLACE)


def test_the_labels_after_a_damaged_frame(tmp_path: Path) -> None:
    """They are those of the frames' numbers; a frame without labels has no hands."""
    source, path = write_labelled(tmp_path, unlabelled=[0, 1])
    (source / "1.png").write_bytes(b"")
    np.save(path, np.load(path)[:3])
    frames = recorded(str(source), [str(path)])
    assert [len(frame.hands) for frame in frames] == [0, 1, 0]


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
    rows = reliability({"one": sure, "two": unsure, "none": []})
    assert len(rows) == 10
    assert {"presence": "80% to 90%", "one": "75% of 40", "two": "", "none": ""} in rows
    assert {"presence": "20% to 30%", "one": "", "two": "25% of 40", "none": ""} in rows


def test_false_detections_are_counted_by_the_name_of_the_object() -> None:
    """A stand-in that finds a hand in the middle of each frame, and one far outside."""

    class Sees:
        def hands(self, depth: Array, camera: Camera, most: int) -> list[FoundHand]:
            middle = camera.unproject([80.0, 64.0, 500.0])
            return [FoundHand(0.9, middle, depth > 0)]

    head, *rows = things_taken_for_hands(cast(Finder, Sees()), 3, 8)
    assert head == ["taken for a hand", "pixels", "times", "a frame"]
    assert sum(int(times) for _, _, times, _ in rows) == 8
    names = {*SceneGenerator(3).names} - {"hand"}
    assert {name for name, *_ in rows} <= names
    shares = [float(share.rstrip("%")) for _, share, *_ in rows]
    assert 0 < sum(shares) <= 100


def test_invalid_labels_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "x.npy").write_bytes(b"no array")
    (tmp_path / "empty.npy").touch()
    np.save(tmp_path / "flat.npy", np.zeros(3))
    for name, message in (
        ("x", "not an array of numbers"),
        ("empty", "not an array of numbers"),
        ("flat", r"float64 \(3,\), expected joints \(frames, \.\.\., 3\)"),
    ):
        with pytest.raises(DataError, match=rf"{name}\.npy: {message}"):
            next(recorded("frames", [str(tmp_path / f"{name}.npy")]))
    np.save(tmp_path / "few.npy", np.zeros((3, 1, 3)))
    with pytest.raises(
        DataError, match=r"few.npy: \(3, 1, 3\), expected joints \(frames, 5, 4, 3\) in mm"
    ):
        constants.labels_of(tmp_path / "few.npy")
    with pytest.raises(
        DataError, match=r"frames: no labels, expected LABELS\.npy after the frames"
    ):
        next(recorded("frames", []))
