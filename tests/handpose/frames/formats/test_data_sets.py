"""handpose/frames/formats/data_sets.py: frames of NYU, ICVL and MSRA15, recognised by their file names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handpose.frames.cameras import ICVL, MSRA15
from handpose.frames.formats.data_sets import read_msra, recognised
from handpose.frames.formats.folder import open_folder
from netlib.errors import DataError
from tests.handpose.frames.conftest import GIVEN, hand_sized, put


def msra(box: tuple[int, int, int, int] = (100, 80, 104, 83), size: tuple[int, int] = (320, 240)) -> bytes:
    """A frame of MSRA15 whose box (left, top, right, bottom) holds 400, 401, ..."""
    left, top, right, bottom = box
    depths = np.arange(400, 400 + max(right - left, 0) * max(bottom - top, 0), dtype="<f4")
    return np.array([*size, *box], "<i4").tobytes() + depths.tobytes()


def test_msra(tmp_path: Path) -> None:
    """The box is placed in an empty frame; the camera is recognised and reported."""
    for number in (0, 1):
        (tmp_path / f"{number:06}_depth.bin").write_bytes(msra())
    (tmp_path / "joint.txt").write_text("2\n")
    recording = open_folder(tmp_path)
    assert (recording.camera, recording.unit_mm, recording.count) == (MSRA15, 1, 2)
    assert recording.remarks[0] == "frames of MSRA15, by their names"
    depth = next(iter(recording)).depth
    assert depth.shape == (240, 320) and np.count_nonzero(depth) == 12
    np.testing.assert_array_equal(depth[80:83, 100:104].ravel(), np.arange(400, 412))


@pytest.mark.parametrize(
    "content",
    [b"", msra()[:20], msra()[:-1], msra() + b"\0", msra(size=(640, 480)), msra((100, 80, 90, 83)), msra((-1, 0, 2, 2)),
     msra((310, 0, 330, 1))],
)
def test_what_is_no_frame_of_msra(tmp_path: Path, content: bytes) -> None:
    """An invalid file raises an error with its size."""
    path = tmp_path / "000000_depth.bin"
    path.write_bytes(content)
    with pytest.raises(DataError, match=f"{len(content)} bytes are no frame of MSRA15: six int32"):
        read_msra(path)


def test_icvl_is_known_by_its_labels(tmp_path: Path) -> None:
    """ICVL is recognised by its label file, because the names of its frames are common."""
    folder = tmp_path / "Training" / "Depth" / "201403121135"
    put(folder / "image_0000.png", hand_sized((240, 320)))
    assert recognised(folder, ["image_0000.png"]) is None
    (tmp_path / "Training" / "labels.txt").write_text("")
    recording = open_folder(folder)
    assert (recording.camera, recording.unit_mm) == (ICVL, 1)
    assert recording.remarks[0].startswith("frames of ICVL")


def test_the_user_knows_better(tmp_path: Path) -> None:
    """Given camera parameters take precedence over a data set's, because own frames may be named alike."""
    put(tmp_path / "depth_1_0000001.png", hand_sized())
    recording = open_folder(tmp_path, GIVEN)
    assert (recording.camera, recording.unit_mm) == (GIVEN.camera, 0.5)
