"""netlib/files/pictures.py: the size in an image's header is checked before the
image is decoded.
"""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from netlib.errors import DataError
from netlib.files import pictures
from tests.support.running import run_python

SIDE = 17_000  # a square of this side exceeds MAX_PIXELS, but not OpenCV's own limit


def bomb(suffix: str) -> bytes:
    """A small image file whose header claims SIDE x SIDE pixels."""
    raw = bytearray(cv2.imencode(suffix, np.zeros((40, 50, 3), np.uint8))[1].tobytes())
    if suffix == ".ppm":
        return raw.replace(b"50 40", b"%d %d" % (SIDE, SIDE))
    place, layout = {
        ".bmp": (18, "<ii"),
        ".jpg": (raw.find(b"\xff\xc0") + 5, ">HH"),
        ".tiff": (raw.find(struct.pack("<HHII", 256, 3, 1, 50)) + 8, "<I"),
    }[suffix]
    size = struct.calcsize(layout)
    raw[place : place + size] = struct.pack(layout, *[SIDE] * len(layout[1:]))
    if suffix == ".tiff":
        place = raw.find(struct.pack("<HHII", 257, 3, 1, 40)) + 8
        raw[place : place + 4] = struct.pack("<I", SIDE)
    return bytes(raw)


@pytest.mark.parametrize("suffix", [".bmp", ".jpg", ".tiff", ".ppm"])
def test_a_picture_of_too_many_pixels_is_not_decoded(tmp_path: Path, suffix: str) -> None:
    """netlib sets a limit below OpenCV's own if it is imported before OpenCV."""
    (tmp_path / "bomb").write_bytes(bomb(suffix))
    code = "import netlib, sys, pathlib; from netlib.files import pictures; "
    code += "pictures.decode(pathlib.Path(sys.argv[1]).read_bytes(), -1, 'p')"
    done = run_python("-c", code, tmp_path / "bomb", status=1, OPENCV_IO_MAX_IMAGE_PIXELS=None)
    assert (
        "p: the image has too many pixels in all; OPENCV_IO_MAX_IMAGE_PIXELS in the env"
        in done.err.splitlines()[-1]
    )


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9, 0.999])
def test_a_truncated_jpeg(part: float, rng: np.random.Generator) -> None:
    """A truncated JPEG is rejected by every version of OpenCV; bytes after its end are ignored."""
    image = rng.integers(0, 255, (40, 50, 3), np.uint8)
    whole = cv2.imencode(".jpg", image)[1].tobytes()
    with pytest.raises(DataError, match=r"^p: truncated JPEG$" if part > 0.5 else "^p: "):
        pictures.decode(whole[: int(len(whole) * part)], cv2.IMREAD_COLOR, "p")
    assert pictures.decode(whole + b"more", cv2.IMREAD_COLOR, "p").shape == (40, 50, 3)


def test_a_picture_with_too_long_a_side() -> None:
    with pytest.raises(
        DataError, match=r"^p: the image has too many pixels in a row; OPENCV_IO_MAX_IMAGE_WIDTH in"
    ):
        pictures.decode(b"P5\n1048581 1\n255\n" + bytes(1048581), cv2.IMREAD_UNCHANGED, "p")
