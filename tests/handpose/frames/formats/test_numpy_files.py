"""handpose/frames/formats/numpy_files.py: headers as NumPy writes them, and damaged ones."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as npy

from handpose.frames.formats import numpy_files
from handpose.frames.formats.numpy_files import NpzFile, header_of
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs


def written(array: np.ndarray, version: tuple[int, int] | None = None) -> bytes:
    """The content of a file written by NumPy."""
    stream = io.BytesIO()
    npy.write_array(stream, array, version)
    return stream.getvalue()


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_a_header(version: tuple[int, int]) -> None:
    """The header gives the shape, the type and the position of the values."""
    array = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    content = written(array, version)
    header = header_of(content, "x")
    assert (header.shape, header.dtype, header.frame_bytes) == ((2, 3, 4), array.dtype, 24)
    np.testing.assert_array_equal(header.frame(content[header.start + 24 :]), array[1])


@bad_inputs(DataError, {
    "empty": (b"", "x: no array as NumPy writes it: ..."),
    "cut": (written(np.zeros((2, 3)))[:40], "x: no array as NumPy writes it: ..."),
    "version 3": (written(np.zeros((2, 3)), (3, 0)), "x: no array as NumPy writes it: its version is 3.0"),
    "a negative size": (written(np.zeros((2, 3))).replace(b"(2, 3)", b"(2,-3)"), "x: an array of shape (2, -3)"),
    "a type": (written(np.zeros((2, 3))).replace(b"'<f8'", b"'a(((")[:200], "x: no array as NumPy writes it: ..."),
})
def test_a_damaged_header(given: bytes, rejected: Any) -> None:
    """A damaged header raises an error of one line."""
    with rejected:
        header_of(given, "x")


def test_frame_by_frame(tmp_path: Path) -> None:
    """Frames are read one by one, with and without compression."""
    depth = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", depth=depth)
        file = NpzFile(tmp_path / "a.npz")
        name, header = file.stack()
        assert (name, header.shape) == ("depth", (2, 3, 4))
        np.testing.assert_array_equal(list(file.frames(name, header)), depth)


def test_small_arrays(tmp_path: Path, monkeypatch) -> None:
    """Small arrays of numbers, texts and dates are read, in any order; large arrays and objects are only named."""
    monkeypatch.setattr(numpy_files, "SMALL", 200)
    np.savez(tmp_path / "a.npz", depth=np.zeros((2, 3, 4)), fx=60.0, camera="{}", large=np.zeros(1000),
             objects=np.array([None]), K=np.eye(3).T, start=np.datetime64("2026-11-28"))
    file = NpzFile(tmp_path / "a.npz")
    assert sorted(file.small()) == ["K", "camera", "fx", "start"]
    assert sorted(file.others()) == ["K", "camera", "fx", "large", "objects", "start"]
