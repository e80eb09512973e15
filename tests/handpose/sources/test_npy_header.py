"""handpose/sources/npy_header.py: headers as NumPy writes them, and damaged ones."""

from __future__ import annotations

import io

import numpy as np
import pytest
from numpy.lib import format as npy

from handpose.sources.npy_header import header_of
from netlib.errors import DataError


def written(array: np.ndarray, version: tuple[int, int] | None = None) -> bytes:
    """A file of NumPy."""
    stream = io.BytesIO()
    npy.write_array(stream, array, version)
    return stream.getvalue()


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_a_header(version: tuple[int, int]) -> None:
    """Shape, type, and where the values begin."""
    array = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    content = written(array, version)
    header = header_of(content, "x")
    assert (header.shape, header.dtype, header.frame_bytes) == ((2, 3, 4), array.dtype, 24)
    np.testing.assert_array_equal(header.frame(content[header.start + 24 :]), array[1])


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "x: no array as NumPy writes it: "),
        (written(np.zeros((2, 3)))[:40], "x: no array as NumPy writes it: "),
        (written(np.zeros((2, 3)), (3, 0)), "its version is 3.0"),
        (written(np.zeros((2, 3))).replace(b"(2, 3)", b"(2,-3)"), r"x: an array of shape \(2, -3\)"),
        (written(np.zeros((2, 3))).replace(b"'<f8'", b"'a(((")[:200], "x: no array as NumPy writes it: "),
        (written(np.asfortranarray(np.zeros((2, 3)))), "x: an array in Fortran's order"),
    ],
)
def test_a_damaged_header(content: bytes, what: str) -> None:
    """One line."""
    with pytest.raises(DataError, match=what):
        header_of(content, "x")
