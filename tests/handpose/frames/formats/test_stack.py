"""handpose/frames/formats/stack.py"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.formats.stack import StackRecording
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, times_of
from tests.handpose.frames.formats.conftest import DEPTH, SECONDS, opened
from tests.support.bad_input import bad_inputs

BESIDE = {"fx": 60.0, "fy": 61.0, "u0": 31.5, "v0": 23.5, "unit_mm": 0.5}


def save(path: Path, depth: np.ndarray = DEPTH) -> Path:
    """Write a stack to a file of the path's kind."""
    np.save(path, depth) if path.suffix == ".npy" else np.savez_compressed(path, depth=depth)
    return path


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
                    "many frames last",
                    np.zeros((240, 320, 100), np.uint16),
                    "an array of shape (240, 320, 100); expected (frames, height, width): np.moveaxis(array, 2, 0)",
                ),
                (
                    "8 bits",
                    np.zeros((3, 4, 5), np.uint8),
                    "values of type uint8; expected depths, of 16 bits or more",
                ),
                (
                    "another size",
                    np.zeros((3, 24, 32), np.uint16),
                    "32 x 24 pixels (if they are the whole image in this size: --camera 30,30.5,15.5,11.5); "
                    "camera own has 64 x 48",
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
