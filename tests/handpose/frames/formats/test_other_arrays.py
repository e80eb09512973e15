"""handpose/frames/formats/stack.py: times and cameras under the names that people give them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats.stack import open_stack
from handpose.frames.inspection import inspect
from handpose.frames.recording import UNKNOWN, CameraInfo, Recording
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, hand_sized
from tests.support.bad_input import bad_inputs

DEPTH = np.stack([hand_sized(distance=1000 + i) for i in range(4)])
SECONDS = np.array([0.0, 0.1, 0.2, 0.4])
MATRIX = np.array([[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]])
ROW = [60, 61, 31.5, 23.5]


def opened(folder: Path, given: CameraInfo = GIVEN, **others: Any) -> Recording:
    """The recording in an archive with these arrays, which has already been read once."""
    np.savez(folder / "take.npz", depth=DEPTH, **others)
    return open_stack(folder / "take.npz", given)


def times_of(recording: Recording) -> list[float]:
    return [frame.time for frame in recording]


@pytest.mark.parametrize("name", [
    "time", "times", "t", "ts", "timestamp", "timestamps", "Timestamps", "time_stamps", "stamp", "stamps",
    "frame_times", "depth_timestamps",
])
def test_names_of_times(tmp_path: Path, name: str) -> None:
    recording = opened(tmp_path, **{name: 1_700_000_000 + SECONDS})
    assert times_of(recording) == pytest.approx(SECONDS, abs=1e-6)
    assert recording.remarks[0] == f"times from {name!r}, in s since 1970" and recording.warnings == ()


@pytest.mark.parametrize(("ending", "unit", "ticks"), [
    ("s", "s", 1), ("seconds", "s", 1), ("ms", "ms", 10**3), ("us", "us", 10**6), ("usec", "us", 10**6),
    ("ns", "ns", 10**9),
])
@pytest.mark.parametrize("name", ["time", "t", "timestamps"])
def test_a_unit_at_the_end_of_the_name(tmp_path: Path, name: str, ending: str, unit: str, ticks: int) -> None:
    """It holds also for steps that no camera has."""
    slow = 100 * SECONDS
    recording = opened(tmp_path, **{f"{name}_{ending}": 5 + ticks * slow})
    assert times_of(recording) == pytest.approx(slow)
    assert recording.remarks[0] == f"times from '{name}_{ending}', in {unit} by its name"


@pytest.mark.parametrize(("unit", "ticks"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_times_since_1970(tmp_path: Path, unit: str, ticks: int) -> None:
    recording = opened(tmp_path, timestamps=ticks * (1_700_000_000 + SECONDS))
    assert times_of(recording) == pytest.approx(SECONDS, abs=1e-6)
    assert recording.remarks[0] == f"times from 'timestamps', in {unit} since 1970"


def test_dates(tmp_path: Path) -> None:
    """NumPy's dates have a unit of their own."""
    stamps = np.datetime64("2026-11-28T04:00:00", "us") + (10**6 * SECONDS).astype("timedelta64[us]")
    recording = opened(tmp_path, stamps=stamps)
    assert times_of(recording) == pytest.approx(SECONDS, abs=1e-6)
    assert recording.remarks[0] == "times from 'stamps', in ns as stored"


def test_times_of_no_known_unit(tmp_path: Path) -> None:
    """A step of 1 may be a second or a frame: refused under any name but the documented one, until it is given."""
    for numbers, step in ((np.arange(4), "1"), ([0.0, 33.0, 66.0, 99.0], "33")):
        with pytest.raises(DataError, match=rf"npz: times has times of an unknown unit, .* of {step}; .* times_ms"):
            opened(tmp_path, times=numbers)
    assert times_of(opened(tmp_path, replace(GIVEN, time_unit="frames"), times=np.arange(4))) == [0, 0.1, 0.2, 0.3]
    seconds = opened(tmp_path, time=np.arange(4))
    assert times_of(seconds) == [0, 1, 2, 3]
    assert seconds.remarks[0] == "times from 'time', taken for s; --time-unit if wrong"


def test_precedence_of_units_of_times(tmp_path: Path) -> None:
    """The command line, the file, camera.json, the values; in the file the name of the array before a key."""
    camera_file.write(tmp_path / "camera.json", CameraInfo(time_unit="us"))
    arrays: dict[str, Any] = {"times": 1000 * SECONDS}
    assert times_of(opened(tmp_path, **arrays)) == pytest.approx(SECONDS / 1000)
    arrays["time_unit"] = "s"
    assert times_of(opened(tmp_path, **arrays)) == pytest.approx(1000 * SECONDS)
    arrays["times_ms"] = arrays.pop("times")
    assert times_of(opened(tmp_path, **arrays)) == pytest.approx(SECONDS)
    recording = opened(tmp_path, replace(GIVEN, time_unit="ns"), **arrays)
    assert times_of(recording) == pytest.approx(SECONDS / 10**6)
    assert recording.remarks[0] == "times from 'times_ms', in ns as given"


def test_of_several_arrays_of_times_one_is_used(tmp_path: Path) -> None:
    """The documented name, otherwise one with a unit; the others are named."""
    recording = opened(tmp_path, stamps_s=5 * SECONDS, time_us=10**6 * SECONDS, time=2 * SECONDS)
    assert times_of(recording) == pytest.approx(2 * SECONDS)
    assert recording.warnings[0].startswith("arrays 'stamps_s', 'time_us' are not used; known names are time, ")
    recording = opened(tmp_path, stamps=5 * SECONDS, time_us=10**6 * SECONDS)
    assert times_of(recording) == pytest.approx(SECONDS) and "array 'stamps' is not used" in recording.warnings[0]


def test_what_is_named_like_times(tmp_path: Path) -> None:
    """The date of a recording, and a translation, are not times of its frames."""
    recording = opened(tmp_path, timestamp=1_700_000_000, t=np.zeros(3))
    assert times_of(recording) == pytest.approx([0, 0.1, 0.2, 0.3])  # by the rate
    assert "arrays 'timestamp', 't' are not used" in recording.warnings[0]


@pytest.mark.parametrize("value", [
    MATRIX, MATRIX.T, MATRIX.ravel(), MATRIX.T.ravel(), MATRIX.astype(np.float32), ROW, [ROW],
])
@pytest.mark.parametrize("name", ["K", "intrinsics", "camera_matrix", "depth_intrinsics", "cam_K", "mtx"])
def test_intrinsics(tmp_path: Path, name: str, value: Any) -> None:
    """A matrix by rows or by columns, or four numbers; the size of the frames belongs to it."""
    recording = opened(tmp_path, UNKNOWN, **{name: value}, width=64, height=48, unit_mm=0.5)
    assert (recording.camera, recording.unit_mm, recording.warnings) == (CAMERA, 0.5, ())
    assert recording.remarks[0] == f"camera from {name!r}, 'width', 'height'; unit from 'unit_mm'"


@pytest.mark.parametrize(("cx", "cy"), [("u0", "v0"), ("cx", "cy"), ("ppx", "ppy")])
def test_four_arrays(tmp_path: Path, cx: str, cy: str) -> None:
    """They have precedence over a matrix, which may be of another camera."""
    recording = opened(tmp_path, UNKNOWN, fx=60, fy=61, **{cx: 31.5, cy: 23.5}, K=2 * MATRIX, unit_mm=1)
    assert recording.camera == CAMERA and "array 'K' is not used" in recording.warnings[0]


@pytest.mark.parametrize(("name", "value", "mm"), [
    ("depth_scale", 0.001, 1.0), ("depth_units", 0.000125, 0.125), ("unit_mm", 0.25, 0.25), ("unit", "mm", 1.0),
    ("units", "m", 1000.0), ("depth_unit", "cm", 10.0), ("unit", "Meters", 1000.0), ("unit", 0.5, 0.5),
])
def test_units_of_depth(tmp_path: Path, name: str, value: Any, mm: float) -> None:
    recording = opened(tmp_path, CameraInfo(CAMERA), **{name: value})
    assert recording.unit_mm == pytest.approx(mm)
    assert recording.remarks[0] == f"unit from {name!r}" and recording.warnings == ()


def test_a_unit_of_something_else(tmp_path: Path) -> None:
    """Where the unit of the depth has its own name, ``unit`` may be of anything."""
    for name in ("unit_mm", "depth_scale", "depth_units"):
        recording = opened(tmp_path, CameraInfo(CAMERA), **{name: 0.001}, unit="radians")
        assert "array 'unit' is not used" in recording.warnings[0]
    assert opened(tmp_path, GIVEN, unit="radians").unit_mm == 0.5  # as the user says


@pytest.mark.parametrize("name", ["rate", "fps", "frame_rate"])
def test_rates(tmp_path: Path, name: str) -> None:
    recording = opened(tmp_path, CameraInfo(CAMERA, unit_mm=1.0), **{name: 20})
    assert recording.rate == 20 and times_of(recording) == pytest.approx([0, 0.05, 0.1, 0.15])
    assert f"rate from {name!r}" in recording.remarks


@pytest.mark.parametrize("name", ["distortion", "coeffs", "dist", "dist_coeffs", "distortion_coefficients", "D"])
def test_distortion(tmp_path: Path, name: str) -> None:
    """Also as OpenCV's calibration returns it, (1, 5); that of another camera is not removed."""
    recording = opened(tmp_path, CameraInfo(unit_mm=0.5), K=MATRIX, **{name: [[-0.2, 0, 0, 0, 0]]})
    assert recording.remarks[0] == f"camera from 'K'; distortion from {name!r}"
    assert "the distortion of the lens is taken out" in recording.remarks
    assert not any(f"from {name!r}" in line for line in open_stack(tmp_path / "take.npz", GIVEN).remarks)


def test_precedence(tmp_path: Path) -> None:
    """The command line, the file, camera.json; nothing is said to be taken from the file that is not."""
    other = Camera("other", 50.0, 50.0, 30.0, 20.0, 64, 48)
    camera_file.write(tmp_path / "camera.json", CameraInfo(other, unit_mm=4.0, rate=40.0))
    mine: dict[str, Any] = {"K": MATRIX, "depth_scale": 0.002, "fps": 20.0}
    found = opened(tmp_path, UNKNOWN, **mine)
    assert (found.camera, found.unit_mm, found.rate) == (replace(CAMERA), 2, 20)
    assert found.remarks == ("camera from 'K'; unit from 'depth_scale'; rate from 'fps'",)
    without = opened(tmp_path, UNKNOWN)
    assert (without.camera, without.unit_mm, without.rate) == (other, 4, 40)
    found = opened(tmp_path, GIVEN, **mine, width=64, height=48, min_range_mm=100)
    assert (found.camera, found.unit_mm, found.rate, found.warnings) == (CAMERA, 0.5, 10, ())
    assert not any("from 'K'" in line or "from 'fps'" in line for line in found.remarks)
    assert opened(tmp_path, GIVEN, K=np.zeros((4, 3, 3))).camera == CAMERA  # of each frame: replaced, not refused


def test_what_is_not_used_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one warning of the report: also what is too large or of another kind to be a parameter."""
    recording = opened(tmp_path, foo=1, color=np.zeros((4, 48, 64, 3), np.uint8), notes=np.array([None]), time=SECONDS)
    (line,) = (line for line in inspect(recording).warnings if "not used" in line)
    assert line.startswith("arrays 'foo', 'color', 'notes' are not used; ") and line.endswith("(docs/camera.md)")
    many = opened(tmp_path, **{f"a{i}": i for i in range(12)})
    assert "'a7' and 4 more are not used" in many.warnings[0]


@bad_inputs(DataError, {
    name: (others, f"...take.npz: {line}") for name, others, line in (
        ("fewer times", {"timestamps": SECONDS[:3]}, "timestamps is float64 (3,), expected (4,): a time ..."),
        ("pairs of times", {"stamps": np.zeros((4, 2))}, "stamps is float64 (4, 2), expected (4,): a time ..."),
        ("words as times", {"times": list("abcd")}, "times is <U1 (4,), expected (4,): a time for each frame"),
        ("times back", {"t": SECONDS[::-1]}, "t[1] is 0.2; expected finite times, each after the one before"),
        ("no date", {"ts": np.array(["NaT"] * 4, "datetime64[s]")}, "ts[1] is ...; expected finite times, ..."),
        ("matrices", {"K": np.zeros((4, 3, 3))}, "K is [[[0.0, 0.0, 0.0], ...; expected [[fx, 0, cx], ..."),
        ("a skew", {"K": MATRIX + [[0, 1, 0], [0, 0, 0], [0, 0, 0]]}, "K is [[60.0, 1.0, 31.5], ...; expected ..."),
        ("no focal length", {"intrinsics": [0.0, 1, 2, 3]}, "fx is 0.0; expected a number more than 1e-06 ..."),
        ("five numbers", {"K": [1, 2, 3, 4, 5]}, "K is [1, 2, 3, 4, 5]; expected [[fx, 0, cx], ..."),
        ("a word", {"unit": "radians"}, "unit is 'radians'; expected mm, cm, m, um or a number of mm"),
        ("units", {"unit": [[1, 2], [3, 4]]}, "unit_mm is [[1, 2], [3, 4]]; expected a number ..."),
        ("a rate twice", {"rate": 30, "frame_rate": 30}, "says rate twice, once as frame_rate"),
        ("a rate by two names", {"fps": 30, "frame_rate": 30}, "says rate twice..."),
    )
})
def test_what_is_wrong(tmp_path: Path, given: dict[str, Any], rejected: Any) -> None:
    with rejected:
        opened(tmp_path, UNKNOWN, **given)
