"""handpose/frames/formats/stack.py: .npy and .npz, with other data in the file, and damaged files."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.formats import stack
from handpose.frames.formats.stack import open_stack
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, hand_sized
from tests.support.bad_input import bad_inputs

DEPTH = np.stack([hand_sized(distance=1000 + i) for i in range(3)])
TIMES = np.array([5.0, 5.25, 6.5])
BESIDE = {"fx": 60.0, "fy": 61.0, "u0": 31.5, "v0": 23.5, "unit_mm": 0.5}


def save(path: Path, depth: np.ndarray = DEPTH, **others: object) -> Path:
    """Write a stack to a file of the path's kind."""
    if path.suffix == ".npy":
        np.save(path, depth)
    else:
        np.savez_compressed(path, depth=depth, **others)
    return path


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
@pytest.mark.parametrize("dtype", [np.uint16, ">u2", np.float32, np.float64])
def test_frames(tmp_path: Path, suffix: str, dtype: str) -> None:
    """Every kind of file and of values is read, repeatedly."""
    recording = open_stack(save(tmp_path / f"take{suffix}", DEPTH.astype(dtype)), GIVEN)
    assert (recording.camera, recording.unit_mm, recording.count, recording.rate) == (CAMERA, 0.5, 3, 10)
    for _ in range(2):
        assert [(frame.number, frame.time) for frame in recording] == [(0, 0), (1, 0.1), (2, 0.2)]
    for frame, stored in zip(recording, DEPTH):
        np.testing.assert_array_equal(frame.depth, stored / np.float32(2))
    assert recording.cut == ""


def test_what_stands_beside_the_frames(tmp_path: Path) -> None:
    """Times may start anywhere; the camera is stored as numbers or as the text of a camera.json."""
    recording = open_stack(save(tmp_path / "a.npz", time=TIMES, **BESIDE))
    assert [frame.time for frame in recording] == [0, 0.25, 1.5]
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 0.5, None)
    assert recording.remarks == ("camera from 'fx', 'fy', 'u0', 'v0'; unit from 'unit_mm'; times from 'time', taken "
                                 "for s; --time-unit if wrong",)
    text = camera_file.to_text(CameraInfo(CAMERA, unit_mm=0.25, rate=20.0))
    recording = open_stack(save(tmp_path / "b.npz", camera=text))
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 0.25, 20)
    assert open_stack(tmp_path / "b.npz", CameraInfo(unit_mm=3.0)).unit_mm == 3


def test_times_of_a_given_unit(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", time=np.array([7000, 7040, 7080]), **BESIDE)
    recording = open_stack(tmp_path / "a.npz", CameraInfo(time_unit="ms"))
    assert [frame.time for frame in recording] == pytest.approx([0, 0.04, 0.08])
    with pytest.raises(DataError, match=r"c\.npy: has no times, so --time-unit has no meaning"):
        open_stack(save(tmp_path / "c.npy"), replace(GIVEN, time_unit="ms"))
    save(tmp_path / "b.npz", time=np.array([3, 4, 6]), rate=20.0, time_unit="frames", **BESIDE)
    assert [frame.time for frame in open_stack(tmp_path / "b.npz", CameraInfo())] == pytest.approx([0, 0.05, 0.15])


def test_every_word_of_a_camera_json(tmp_path: Path) -> None:
    """Numbers, lists and texts in addition to the frames have the same keys as a camera.json."""
    said: dict[str, Any] = {
        "fx": 60, "fy": 61.0, "ppx": 31.5, "ppy": 23.5, "width": 64, "height": 48, "name": "mine", "fps": 20.0,
        "depth_units": 0.000125, "model": "brown_conrady", "coeffs": [-0.2, 0.0, 0.0, 0.0, 0.0],
    }
    depth = np.random.default_rng(0).integers(4000, 8000, DEPTH.shape).astype(np.uint16)
    recording = open_stack(save(tmp_path / "a.npz", depth, **said))
    expected = camera_file.of(said, "")
    assert (recording.camera, recording.unit_mm, recording.rate) == (expected.camera, 0.125, 20)
    straight = {key: value for key, value in said.items() if key not in ("model", "coeffs")}
    plain = open_stack(save(tmp_path / "b.npz", depth, **straight))
    assert not np.array_equal(next(iter(recording)).depth, next(iter(plain)).depth)
    found = open_stack(save(tmp_path / "c.npz", name="a take", model="D435", width=3.0), GIVEN)  # another meaning
    assert all(name in found.warnings[0].partition(" are not used")[0] for name in ("'name'", "'model'", "'width'"))


def test_camera_json_beside(tmp_path: Path) -> None:
    """A camera.json with the file's own name is used."""
    camera_file.write(tmp_path / "take.camera.json", GIVEN)
    assert open_stack(save(tmp_path / "take.npy")).unit_mm == 0.5


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_one_image(tmp_path: Path, suffix: str) -> None:
    """A single image is a stack of one, with or without its time."""
    for time in ({}, {} if suffix == ".npy" else {"time": TIMES[:1]}):
        recording = open_stack(save(tmp_path / f"one{suffix}", DEPTH[0], **time), GIVEN)
        (frame,) = recording
        assert (recording.count, frame.number, frame.time) == (1, 0, 0)
        np.testing.assert_array_equal(frame.depth, DEPTH[0] / np.float32(2))


def test_a_stack_by_another_name(tmp_path: Path) -> None:
    """The only array of three axes is used, under any name."""
    np.savez(tmp_path / "other.npz", frames=DEPTH, joints=np.zeros((3, 2)))
    assert open_stack(tmp_path / "other.npz", GIVEN).count == 3


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


@bad_inputs(DataError, {
    **{f"{name} in {suffix}": (lambda tmp, suffix=suffix, depth=depth: save(tmp / f"take{suffix}", depth),
                               f"...take{suffix}: {line}")
       for suffix in (".npy", ".npz") for name, depth, line in (
        ("four axes", np.zeros((3, 4, 5, 1), np.uint16),
         "an array of shape (3, 4, 5, 1); expected (frames, height, width)"),
        ("8 bits", np.zeros((3, 4, 5), np.uint8), "values of type uint8; expected depths, of 16 bits or more"),
        ("another size", np.zeros((3, 24, 32), np.uint16), "32 x 24 pixels; camera own has 64 x 48"),
    )},
    "no frames": (lambda tmp: archive(tmp / "a.npz", depth=np.zeros((0, 4, 5), np.uint16)),
                  "...a.npz: an array of shape (0, 4, 5); expected (frames, ..."),
    "objects": (lambda tmp: save(tmp / "take.npz", np.full((3, 4, 5), None)),  # not unpickled
                "...take.npz: values of type object; expected depths, of 16 bits or more"),
    "a text file": (lambda tmp: text(tmp / "take.npy"), "...take.npy: cut, or not an array as NumPy writes it: ..."),
    "a negative depth": (lambda tmp: save(tmp / "take.npy", np.where(DEPTH == 1001, -1.0, DEPTH)),
                         "...take.npy: frame 1: a depth of -0.5 mm; expected 0 where nothing was read, else more"),
    "a cut array": (lambda tmp: cut(save(tmp / "take.npy"), 9000),
                    "...take.npy: cut, or not an array as NumPy writes it: ..."),
    "a wrong checksum": (lambda tmp: cut(archive(tmp / "take.npz", depth=DEPTH), flip=5000),
                         "...take.npz: a damaged .npz file: Bad CRC-32..."),
    "a cut archive": (lambda tmp: cut(archive(tmp / "take.npz", depth=DEPTH), 9000),
                      "...take.npz: a damaged .npz file: File is not a zip file"),
    "columns first": (lambda tmp: archive(tmp / "a.npz", depth=np.asfortranarray(DEPTH)),
                      "...a.npz: an array in Fortran's order; write it with numpy.ascontiguousarray"),
    "joints": (lambda tmp: archive(tmp / "a.npz", joints=np.zeros((3, 2))),
               f"...a.npz: holds joints (3, 2); {EXPECTED}"),
    "two stacks": (lambda tmp: archive(tmp / "a.npz", a=DEPTH, b=DEPTH),
                   f"...a.npz: holds a (3, 48, 64), b (3, 48, 64); {EXPECTED}"),
    "a text": (lambda tmp: text(tmp / "a.npz"), f"...a.npz: holds nothing; {EXPECTED}"),
})
def test_what_is_no_stack(tmp_path: Path, given: Callable[[Path], Path], rejected: Any) -> None:
    """An invalid array, a damaged archive and one without a stack raise an error."""
    path = given(tmp_path)
    with rejected:
        list(open_stack(path, GIVEN))


@bad_inputs(DataError, {
    name: (others, f"...take.npz: {line}") for name, others, line in (
        ("a time before", {"time": [0.0, 2.0, 1.0]}, "time[2] is 1; expected finite times, each after ..."),
        ("no time", {"time": [0.0, 1.0, np.nan]}, "time[2] is nan; expected finite times, each after the one before"),
        ("two times", {"time": [0.0, 1.0]}, "time is float64 (2,), expected (3,): a time for each frame"),
        ("fx alone", {"fx": 60.0}, "has fx, but not fy and u0 and v0"),
        ("two units", {"unit_mm": [1.0, 2.0]}, "unit_mm is [1.0, 2.0]; expected a number more than 0 and ..."),
        ("a text as rate", {"rate": "fast"}, 'rate is "fast"; expected a number more than 0 and at most 10000'),
        ("a camera's fx alone", {"camera": '{"fx": 1}'}, "camera: has fx, but not fy and u0 and v0"),
        ("two cameras", {"camera": ["a", "b"]}, "camera has the shape (2,), expected one text: a camera.json"),
    )
})
def test_what_is_wrong_beside_the_frames(tmp_path: Path, given: dict[str, object], rejected: Any) -> None:
    """Invalid data in addition to the frames raise an error."""
    path = save(tmp_path / "take.npz", **given)
    with rejected:
        open_stack(path, GIVEN)


def test_only_small_arrays_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The others are named; the frames are read one by one."""
    monkeypatch.setattr(stack, "SMALL", 200)
    np.savez(tmp_path / "a.npz", depth=DEPTH, fx=60.0, large=np.zeros(1000), objects=np.array([None]), K=np.eye(3).T)
    frames = stack._Npz(tmp_path / "a.npz")
    assert sorted(frames.others) == ["K", "fx"] and frames.names == ["fx", "large", "objects", "K"]
    np.testing.assert_array_equal(next(iter(frames)), DEPTH[0])
