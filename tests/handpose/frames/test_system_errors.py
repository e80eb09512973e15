"""All sources of frames: an error of the system ends the reading, and is no damage of a file."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats import open_recording
from handpose.frames.images import BadFrameError, read_png
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError, system_error_of
from netlib.files import reading

CAMERA = Camera("own", 60, 60, 15.5, 11.5, 32, 24)
DEPTH = np.full((4, 24, 32), 500, np.uint16)


def folder(path: Path) -> Path:
    place = path / "frames"
    place.mkdir()
    for i, image in enumerate(DEPTH):
        (place / f"{i:03}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    return place


def archive(path: Path) -> Path:
    np.savez(path / "take.npz", depth=DEPTH)
    return path / "take.npz"


class Failing(FileIO):
    """A file whose reads fail with ``number`` once ``left`` of them were made."""

    number, left = 0, 0

    def _fail(self) -> None:
        Failing.left -= 1
        if Failing.left < 0:
            raise OSError(Failing.number, os.strerror(Failing.number))

    def read(self, size: int | None = -1) -> bytes:  # type: ignore[override]
        self._fail()
        return super().read(size) or b""

    def readinto(self, buffer: Any) -> int:
        self._fail()
        return super().readinto(buffer) or 0


@pytest.mark.parametrize("make", [folder, archive])
def test_reads_that_fail(make: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A read that the system refuses raises DataError with its reason, wherever it happens."""
    place = make(tmp_path)
    monkeypatch.setattr(reading, "FileIO", Failing)
    monkeypatch.setattr(Failing, "number", errno.EIO)
    reached = []
    for left in range(0, 12, 2):
        Failing.left = left
        try:
            with open_recording(place, CameraInfo(CAMERA)) as recording:
                frames = list(recording)
        except DataError as error:
            assert "Input/output error" in str(error) and "damaged" not in str(error) and system_error_of(error)
            reached.append(left)
        else:
            assert len(frames) == len(DEPTH) and not recording.cut and "damaged" not in str(recording.remarks)
    assert reached


def test_a_folder_that_cannot_be_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that cannot be listed raises an error with its reason; it is not taken for an empty one."""
    place = folder(tmp_path)
    monkeypatch.setattr(os, "scandir", lambda path: (_ for _ in ()).throw(OSError(errno.EMFILE, "Too many open files")))
    with pytest.raises(DataError, match=r"frames: cannot read the folder: Too many open files$"):
        open_recording(place, CameraInfo(CAMERA))


def test_a_published_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame of a data set that the system does not read is not counted as a bad frame."""
    path = folder(tmp_path) / "000.png"
    monkeypatch.setattr(reading, "FileIO", Failing)
    monkeypatch.setattr(Failing, "number", errno.EIO)
    monkeypatch.setattr(Failing, "left", 0)
    with pytest.raises(DataError, match="Input/output error") as raised:
        read_png(path)
    assert not isinstance(raised.value, BadFrameError)
