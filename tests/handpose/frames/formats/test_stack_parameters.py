"""handpose/frames/formats/stack_parameters.py, through the recordings of .npz files"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats.stack import StackRecording
from handpose.frames.inspection import inspect
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, times_of
from tests.handpose.frames.formats.conftest import SECONDS, opened
from tests.support.bad_input import bad_inputs

MATRIX = np.array([[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]])
TICKS = {"s": 1, "seconds": 1, "ms": 10**3, "us": 10**6, "usec": 10**6, "ns": 10**9}
UNITS = {"seconds": "s", "usec": "us"}
TIMES = "time times t ts timestamp Timestamps time_stamps stamps frame_times depth_timestamps"


@pytest.mark.parametrize(
    ("name", "times", "how"),
    [
        *((name, 1_700_000_000 + SECONDS, "in s since 1970") for name in TIMES.split()),
        *(
            ("timestamps", TICKS[unit] * (1_700_000_000 + SECONDS), f"in {unit} since 1970")
            for unit in ("ms", "us", "ns")
        ),
        ("timestamps", 10**7 * (13_000_000_000 + SECONDS), "in 100ns since 1601"),  # HoloLens
        *(
            (f"{name}_{unit}", 5 + TICKS[unit] * SECONDS, f"in {UNITS.get(unit, unit)} by its name")
            for name in ("time", "t", "timestamps")
            for unit in ("s", "seconds", "ms", "usec", "ns")
        ),
    ],
)
def test_names_and_units_of_times(tmp_path: Path, name: str, times: Any, how: str) -> None:
    recording = opened(tmp_path, **{name: times})
    assert times_of(recording) == pytest.approx(SECONDS, abs=1e-6)
    assert recording.remarks[0] == f"times from {name!r}, {how}" and recording.warnings == ()


def test_times_that_are_dates(tmp_path: Path) -> None:
    dates = np.datetime64("2024-02-29") + (1e6 * SECONDS).astype("timedelta64[us]")
    recording = opened(tmp_path, timestamps=dates)
    assert times_of(recording) == pytest.approx(SECONDS, abs=1e-6)
    assert recording.remarks[0] == "times from 'timestamps', in ns since 1970"


def test_times_of_no_known_unit(tmp_path: Path) -> None:
    """A step of 1 may be a second or a frame: refused under any name but the documented one,
    until it is given.
    """
    for numbers, step in ((np.arange(4), "1"), ([0.0, 33.0, 66.0, 99.0], "33")):
        with pytest.raises(
            DataError, match=rf"npz: times has times of an unknown unit, .* of {step}; .* times_ms"
        ):
            opened(tmp_path, times=numbers)
    assert times_of(opened(tmp_path, replace(GIVEN, time_unit="frames"), times=np.arange(4))) == [
        0,
        0.1,
        0.2,
        0.3,
    ]
    seconds = opened(tmp_path, time=np.arange(4))
    assert times_of(seconds) == [0, 1, 2, 3]
    assert seconds.remarks[0] == "times from 'time', taken for s; --time-unit if wrong"


def test_precedence_of_units_of_times(tmp_path: Path) -> None:
    """The command line, the file, camera.json, the values; in the file the name of the
    array before a key.
    """
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


def test_one_of_several_arrays_of_times_is_used(tmp_path: Path) -> None:
    """The documented name, otherwise one with a unit; the others are named."""
    recording = opened(tmp_path, stamps_s=5 * SECONDS, time_us=10**6 * SECONDS, time=2 * SECONDS)
    assert times_of(recording) == pytest.approx(2 * SECONDS)
    assert recording.warnings[0].startswith(
        "arrays 'stamps_s', 'time_us' are not used; known names are time, "
    )
    recording = opened(tmp_path, stamps=5 * SECONDS, time_us=10**6 * SECONDS)
    assert times_of(recording) == pytest.approx(SECONDS)
    assert "array 'stamps' is not used" in recording.warnings[0]


def test_a_date_and_a_translation_are_not_taken_for_times(tmp_path: Path) -> None:
    recording = opened(tmp_path, timestamp=1_700_000_000, t=np.zeros(3))
    assert times_of(recording) == pytest.approx([0, 0.1, 0.2, 0.3])  # by the rate
    assert "arrays 'timestamp', 't' are not used" in recording.warnings[0]


@pytest.mark.parametrize(
    "name", ["distortion", "coeffs", "dist", "dist_coeffs", "distortion_coefficients", "D"]
)
def test_distortion(tmp_path: Path, name: str) -> None:
    """Also as OpenCV's calibration returns it, (1, 5); that of another camera is not removed."""
    recording = opened(tmp_path, CameraInfo(unit_mm=0.5), K=MATRIX, **{name: [[-0.2, 0, 0, 0, 0]]})
    assert recording.remarks[0] == f"parameters from 'K', {name!r}"
    assert "the distortion of the lens is taken out" in recording.remarks
    assert not any(
        name in line.split("'") for line in StackRecording(tmp_path / "take.npz", GIVEN).remarks
    )


def test_precedence(tmp_path: Path) -> None:
    """The command line, the file, camera.json; nothing is said to be taken from the
    file that is not.
    """
    other = Camera("other", 50.0, 50.0, 30.0, 20.0, 64, 48)
    camera_file.write(tmp_path / "camera.json", CameraInfo(other, unit_mm=4.0, rate=40.0))
    mine: dict[str, Any] = {"K": MATRIX, "depth_scale": 0.002, "fps": 20.0}
    found = opened(tmp_path, UNKNOWN, **mine)
    assert (found.camera, found.unit_mm, found.rate) == (replace(CAMERA), 2, 20)
    assert found.remarks == ("parameters from 'K', 'depth_scale', 'fps'",)
    without = opened(tmp_path, UNKNOWN)
    assert (without.camera, without.unit_mm, without.rate) == (other, 4, 40)
    found = opened(tmp_path, GIVEN, **mine, width=64, height=48, min_range_mm=100)
    assert (found.camera, found.unit_mm, found.rate, found.warnings) == (CAMERA, 0.5, 10, ())
    assert not any("'K'" in line or "'fps'" in line for line in found.remarks)
    # of each frame: replaced, not refused
    assert opened(tmp_path, GIVEN, K=np.zeros((4, 3, 3))).camera == CAMERA


def test_unused_arrays_are_named_in_one_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also those that are too large, or of another kind, to be a parameter."""
    recording = opened(
        tmp_path,
        foo=1,
        color=np.zeros((4, 48, 64, 3), np.uint8),
        notes=np.array([None]),
        time=SECONDS,
    )
    (line,) = (line for line in inspect(recording).warnings if "not used" in line)
    assert line.startswith("arrays 'foo', 'color', 'notes' are not used; ")
    assert line.endswith("(docs/camera.md)")
    many = opened(tmp_path, **{f"a{i}": i for i in range(12)})
    assert "'a7' and 4 more are not used" in many.warnings[0]


@bad_inputs(
    DataError,
    {
        name: (others, f"...take.npz: {line}")
        for name, others, line in (
            (
                "no time",
                {"time": [0.0, 1.0, np.nan, 2]},
                "time[2] is nan; expected finite times, each after ...",
            ),
            (
                "fewer times",
                {"timestamps": SECONDS[:3]},
                "timestamps is float64 (3,), expected (4,): a time ...",
            ),
            (
                "pairs of times",
                {"stamps": np.zeros((4, 2))},
                "stamps is float64 (4, 2), expected (4,): a time ...",
            ),
            (
                "words as times",
                {"times": list("abcd")},
                "times is <U1 (4,), expected (4,): a time for each frame",
            ),
            (
                "times back",
                {"t": SECONDS[::-1]},
                "t[1] is 0.2; expected finite times, each after the one before",
            ),
            ("fx alone", {"fx": 60.0}, "has fx, but not fy and u0 and v0"),
            (
                "matrices",
                {"K": np.zeros((4, 3, 3))},
                "K is [[[0.0, 0.0, 0.0], ...; expected [[fx, 0, cx], ...",
            ),
            (
                "two units",
                {"unit_mm": [1.0, 2.0]},
                "unit_mm is [1.0, 2.0]; expected a number more than 1e-06 and ...",
            ),
            (
                "too many numbers",
                {"K": np.zeros(1001)},
                "K is float64 (1001,), expected numbers, or a text",
            ),
            (
                "a camera's fx alone",
                {"camera": '{"fx": 1}'},
                "camera: has fx, but not fy and u0 and v0",
            ),
            (
                "two cameras",
                {"camera": ["a", "b"]},
                "camera is <U1 (2,), expected numbers, or a text",
            ),
        )
    },
)
def test_invalid_times_and_parameters_are_rejected(
    tmp_path: Path, given: dict[str, Any], rejected: Any
) -> None:
    with rejected:
        opened(tmp_path, UNKNOWN, **given)
