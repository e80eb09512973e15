"""All sources of frames: an error of the system ends the reading, and is no damage of a file."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames.formats import open_recording
from handpose.frames.images import BadFrameError, read_png
from netlib.errors import DataError, system_error_of
from netlib.files import reading
from tests.handpose.frames.conftest import GIVEN, hand_sized


class Failing(FileIO):
    """A file whose reads fail once ``left`` of them were made."""

    left = 0

    def _fail(self) -> None:
        Failing.left -= 1
        if Failing.left < 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def read(self, size: int | None = -1) -> bytes:  # type: ignore[override]
        self._fail()
        return super().read(size) or b""

    def readinto(self, buffer: Any) -> int:
        self._fail()
        return super().readinto(buffer) or 0


def read_all(place: Path) -> None:
    with open_recording(place, GIVEN) as recording:
        assert len(list(recording)) == 3
        assert not recording.cut
        assert "damaged" not in str(recording.remarks)


@pytest.mark.parametrize(
    ("name", "read"), [("", read_all), ("take.npz", read_all), ("1.png", read_png)]
)
def test_reads_that_fail(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, read: Callable[[Path], object]
) -> None:
    """A read that the system refuses raises DataError with its reason, wherever it happens; no
    frame counts as bad.
    """
    np.savez(folder / "take.npz", depth=[hand_sized()] * 3)
    monkeypatch.setattr(reading, "FileIO", Failing)
    reached = []
    for left in range(0, 12, 2):
        Failing.left = left
        try:
            read(folder / name)
        except DataError as error:
            assert "Input/output error" in str(error)
            assert "damaged" not in str(error)
            assert system_error_of(error)
            assert not isinstance(error, BadFrameError)
            reached.append(left)
    assert reached


def test_a_folder_that_cannot_be_listed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that cannot be listed raises an error with its reason; it is not taken
    for an empty one.
    """
    monkeypatch.setattr(
        os,
        "scandir",
        lambda path: (_ for _ in ()).throw(OSError(errno.EMFILE, "Too many open files")),
    )
    with pytest.raises(DataError, match=r"cannot read the folder: Too many open files$"):
        open_recording(folder, GIVEN)
