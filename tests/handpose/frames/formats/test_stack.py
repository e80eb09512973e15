"""handpose/frames/formats/stack.py: frames of .npy and .npz files, and the times and cameras
stored beside them
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats.stack import StackRecording
from handpose.frames.inspection import inspect
from handpose.frames.recording import UNKNOWN, CameraInfo, Recording
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, hand_sized, times_of
from tests.support.bad_input import bad_inputs

DEPTH = np.stack([hand_sized(distance=1000 + i) for i in range(4)])
SECONDS = np.array([0.0, 0.1, 0.2, 0.4])
MATRIX = np.array([[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]])
BESIDE = {"fx": 60.0, "fy": 61.0, "u0": 31.5, "v0": 23.5, "unit_mm": 0.5}


def save(path: Path, depth: np.ndarray = DEPTH) -> Path:
    """Write a stack to a file of the path's kind."""
    np.save(path, depth) if path.suffix == ".npy" else np.savez_compressed(path, depth=depth)
    return path


def opened(folder: Path, given: CameraInfo = GIVEN, **others: Any) -> Recording:
    """The recording in an archive with these arrays."""
    np.savez(folder / "take.npz", **{"depth": DEPTH, **others})
    return StackRecording(folder / "take.npz", given)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
@pytest.mark.parametrize("dtype", [np.uint16, ">u2", np.float32, np.float64])
def test_frames(tmp_path: Path, suffix: str, dtype: str) -> None:
    recording = StackRecording(save(tmp_path / f"take{suffix}", DEPTH.astype(dtype)), GIVEN)
    assert (recording.camera, recording.unit_mm) == (CAMERA, 0.5)
    assert (recording.count, recording.rate) == (4, 10)
    for _ in range(2):
        assert [frame.number for frame in recording] == [0, 1, 2, 3]
        assert times_of(recording) == pytest.approx([0, 0.1, 0.2, 0.3])
    for frame, stored in zip(recording, DEPTH):
        np.testing.assert_array_equal(frame.depth, stored / np.float32(2))
    assert recording.cut == ""


def test_times_and_camera_are_read_with_the_frames(tmp_path: Path) -> None:
    """Times may start anywhere; the camera is stored as numbers or as the text of a camera.json."""
    recording = opened(tmp_path, UNKNOWN, time=5 + SECONDS, **BESIDE)
    assert times_of(recording) == pytest.approx(SECONDS)
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 0.5, None)
    assert recording.remarks == (
        "parameters from 'fx', 'fy', 'u0', 'v0', 'unit_mm'; times from 'time', taken for s; "
        "--time-unit if wrong",
    )
    text = camera_file.to_text(CameraInfo(CAMERA, unit_mm=0.25, rate=20.0))
    recording = opened(tmp_path, UNKNOWN, camera=text)
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 0.25, 20)
    assert opened(tmp_path, CameraInfo(unit_mm=3.0), camera=text).unit_mm == 3


def test_times_of_a_given_unit(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"c\.npy: has no times, so --time-unit has no meaning"):
        StackRecording(save(tmp_path / "c.npy"), replace(GIVEN, time_unit="ms"))
    counted = opened(
        tmp_path, UNKNOWN, time=np.array([3, 4, 6, 7]), rate=20.0, time_unit="frames", **BESIDE
    )
    assert times_of(counted) == pytest.approx([0, 0.05, 0.15, 0.2])


def test_a_stack_by_another_name(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", frames=DEPTH, joints=np.zeros((3, 2)))
    assert StackRecording(tmp_path / "other.npz", GIVEN).count == 4


def test_a_single_frame_has_no_rate(tmp_path: Path) -> None:
    assert (
        StackRecording(save(tmp_path / "one.npy", DEPTH[:1]), replace(GIVEN, rate=None)).rate
        is None
    )


EXPECTED = "expected an array depth (frames, height, width)"


def archive(path: Path, **arrays: np.ndarray) -> Path:
    np.savez(path, **arrays)
    return path


def text(path: Path) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "nothing")
    return path


def cut(path: Path, size: int | None = None, flip: int = 0) -> Path:
    """Cut a file, and change a byte of it."""
    content = bytearray(path.read_bytes()[:size])
    content[flip] ^= bool(flip)
    path.write_bytes(content)
    return path


@bad_inputs(
    DataError,
    {
        **{
            f"{name} in {suffix}": (
                lambda tmp, suffix=suffix, depth=depth: save(tmp / f"take{suffix}", depth),
                f"...take{suffix}: {line}",
            )
            for suffix in (".npy", ".npz")
            for name, depth, line in (
                (
                    "one image",
                    np.zeros((48, 64), np.uint16),
                    "an array of shape (48, 64); expected (frames, height, width)",
                ),
                (
                    "four axes",
                    np.zeros((3, 4, 5, 1), np.uint16),
                    "an array of shape (3, 4, 5, 1); expected (frames, height, width)",
                ),
                (
                    "frames last",
                    np.zeros((24, 32, 5), np.uint16),
                    "an array of shape (24, 32, 5); expected (frames, height, width): np.moveaxis(array, 2, 0)",
                ),
                (
                    "8 bits",
                    np.zeros((3, 4, 5), np.uint8),
                    "values of type uint8; expected depths, of 16 bits or more",
                ),
                (
                    "another size",
                    np.zeros((3, 24, 32), np.uint16),
                    "32 x 24 pixels; camera own has 64 x 48",
                ),
            )
        },
        "no frames": (
            lambda tmp: archive(tmp / "a.npz", depth=np.zeros((0, 4, 5), np.uint16)),
            "...a.npz: an array of shape (0, 4, 5); expected (frames, ...",
        ),
        "objects": (
            lambda tmp: save(tmp / "take.npz", np.full((3, 4, 5), None)),  # not unpickled
            "...take.npz: values of type object; expected depths, of 16 bits or more",
        ),
        "a text file": (
            lambda tmp: text(tmp / "take.npy"),
            "...take.npy: cut, or not an array as NumPy writes it: ...",
        ),
        "a negative depth": (
            lambda tmp: save(tmp / "take.npy", np.where(DEPTH == 1001, -1.0, DEPTH)),
            "...take.npy: frame 1: a depth of -0.5 mm; expected 0 where nothing was read, else more",
        ),
        "a cut array": (
            lambda tmp: cut(save(tmp / "take.npy"), 9000),
            "...take.npy: cut, or not an array as NumPy writes it: ...",
        ),
        "a wrong checksum": (
            lambda tmp: cut(archive(tmp / "take.npz", depth=DEPTH), flip=5000),
            "...take.npz: a damaged .npz file: Bad CRC-32...",
        ),
        "a cut archive": (
            lambda tmp: cut(archive(tmp / "take.npz", depth=DEPTH), 9000),
            "...take.npz: a damaged .npz file: File is not a zip file",
        ),
        "columns first": (
            lambda tmp: archive(tmp / "a.npz", depth=np.asfortranarray(DEPTH)),
            "...a.npz: an array in Fortran's order; write it with numpy.ascontiguousarray",
        ),
        "joints": (
            lambda tmp: archive(tmp / "a.npz", joints=np.zeros((3, 2))),
            f"...a.npz: holds joints (3, 2); {EXPECTED}",
        ),
        "two stacks": (
            lambda tmp: archive(tmp / "a.npz", a=DEPTH, b=DEPTH),
            f"...a.npz: holds a (4, 48, 64), b (4, 48, 64); {EXPECTED}",
        ),
        "a frame each": (
            lambda tmp: archive(tmp / "a.npz", **{f"f{i}": DEPTH[0] for i in range(10)}),
            f"...a.npz: holds f0 (48, 64), ..., f7 (48, 64) and 2 more; {EXPECTED}",
        ),
        "a text": (lambda tmp: text(tmp / "a.npz"), f"...a.npz: holds nothing; {EXPECTED}"),
    },
)
def test_invalid_stacks_are_rejected(
    tmp_path: Path, given: Callable[[Path], Path], rejected: Any
) -> None:
    path = given(tmp_path)
    with rejected:
        list(StackRecording(path, GIVEN))


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
