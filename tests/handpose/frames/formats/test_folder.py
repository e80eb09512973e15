"""handpose/frames/formats/folder.py: folders of 16-bit pictures, patterns of names, damaged frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.cameras import NYU
from handpose.frames.formats.folder import open_folder
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, hand_sized, put
from tests.support.bad_input import bad_inputs
from tests.support.nyu_data_set import pack_depth


def test_frames_by_number(folder: Path) -> None:
    """Frames are in numerical order, a missing number is a gap in time, and depth is in mm."""
    recording = open_folder(folder, GIVEN)
    frames = list(recording)
    assert (recording.name, recording.count, recording.rate) == (str(folder), 3, 10)
    assert (recording.camera, recording.unit_mm, recording.cut) == (CAMERA, 0.5, "")
    assert [(frame.number, frame.time) for frame in frames] == [(0, 0.0), (1, 0.1), (2, 0.3)]
    assert [frame.depth[20, 30] for frame in frames] == [500.5, 501, 502]
    assert recording.remarks == (
        "frames in the order of the numbers in their names; numbers missing between 1 and 4: 1, which stay gaps in "
        "time (--time-unit if they are times)", "camera own, by --camera")


def test_the_rate_is_assumed_and_said(folder: Path) -> None:
    recording = open_folder(folder, replace(GIVEN, rate=None))
    assert [frame.time for frame in recording] == [0, 1 / 30, 0.1]
    assert recording.remarks[-1].startswith("rate unknown: 30 frames per second assumed")


def test_times_in_names(tmp_path: Path) -> None:
    for stamp in (1616799936125, 1616799936175):
        put(tmp_path / f"{stamp}.png", hand_sized())
    recording = open_folder(tmp_path, replace(GIVEN, rate=None))
    assert [frame.time for frame in recording] == [0, 0.05]
    assert recording.rate is None and "in ms since 1970" in recording.remarks[0]


def test_a_given_unit_of_the_times(tmp_path: Path) -> None:
    """Times that show no unit are numbers of frames, unless their unit is given, here or in camera.json."""
    for stamp in (5000, 5100, 5200):
        put(tmp_path / f"{stamp}.png", hand_sized())
    given = replace(GIVEN, rate=None)
    assert [frame.time for frame in open_folder(tmp_path, given)] == pytest.approx([0, 100 / 30, 200 / 30])
    timed = open_folder(tmp_path, replace(given, time_unit="ms"))
    assert [frame.time for frame in timed] == [0, 0.1, 0.2]
    assert timed.remarks[0] == "times from the file names, in ms as given: a frame every 100 ms"
    (tmp_path / "camera.json").write_text('{"time_unit": "ms"}')
    assert [frame.time for frame in open_folder(tmp_path, given)] == [0, 0.1, 0.2]
    counted = open_folder(tmp_path, replace(GIVEN, rate=100.0, time_unit="frames"))
    assert [frame.time for frame in counted] == [0, 1, 2]


def test_a_pattern_and_a_name(tmp_path: Path) -> None:
    for name in ("a_1", "a_2", "b_1"):
        put(tmp_path / f"{name}.png", hand_sized())
    with pytest.raises(DataError, match="holds 2 sequences"):
        open_folder(tmp_path, GIVEN)
    assert open_folder(tmp_path / "a_*.png", GIVEN).count == 2
    assert open_folder(tmp_path / "b_1.png", GIVEN).count == 1


@pytest.mark.parametrize("suffix", [".tif", ".TIFF", ".PNG"])
def test_other_endings(tmp_path: Path, suffix: str) -> None:
    """TIFF, and suffixes in capitals, are accepted."""
    put(tmp_path / f"1{suffix}", hand_sized())
    assert [frame.depth[20, 30] for frame in open_folder(tmp_path, GIVEN)] == [500]


def test_a_float_picture_needs_its_unit(tmp_path: Path) -> None:
    """A floating-point picture requires a unit, because it may be in metres."""
    put(tmp_path / "1.tif", hand_sized().astype(np.float32) / 1000)
    with pytest.raises(DataError, match="depth of unknown unit; give --unit 1 for mm, --unit 1000 for metres"):
        open_folder(tmp_path, replace(GIVEN, unit_mm=None))
    (frame,) = open_folder(tmp_path, replace(GIVEN, unit_mm=1000.0))
    assert frame.depth[20, 30] == 1000


def test_camera_json(folder: Path) -> None:
    """camera.json in the folder is used, and given parameters take precedence."""
    camera_file.write(folder / "camera.json", CameraInfo(CAMERA, unit_mm=2.0, rate=5.0))
    recording = open_folder(folder)
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 2, 5)
    assert f"camera own, by {folder / 'camera.json'}" in recording.remarks
    assert open_folder(folder / "*.png", CameraInfo(unit_mm=1.0)).unit_mm == 1


def test_a_damaged_frame_is_left_out_and_said(folder: Path) -> None:
    """Its number and time are skipped, and a remark reports it."""
    path = folder / "2.png"
    path.write_bytes(path.read_bytes()[:-30])
    recording = open_folder(folder, GIVEN)
    before = recording.remarks
    for _ in range(2):
        assert [(frame.number, frame.time) for frame in recording] == [(0, 0.0), (2, 0.3)]
        assert recording.remarks == (
            *before, f"1 damaged frames are left out, the first: {path}: truncated or damaged PNG")


def test_all_frames_are_damaged(folder: Path) -> None:
    for path in folder.iterdir():
        path.write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"1\.png: not an image that OpenCV can decode"):
        open_folder(folder, GIVEN)


def test_the_first_frame_is_damaged(folder: Path) -> None:
    """If the first frame is damaged, the next one determines the size."""
    (folder / "1.png").write_bytes(b"")
    assert [frame.number for frame in open_folder(folder, GIVEN)] == [1, 2]


@bad_inputs(DataError, {
    "another size": (hand_sized((24, 32)), "...2.png: 32 x 24 pixels; the camera has 64 x 48"),
    "8 bits": (np.zeros((48, 64), np.uint8),
               "...2.png: a picture of uint8 grey values; expected depth, a 16-bit grey picture"),
    "colours": (np.zeros((48, 64, 3), np.uint8),
                "...2.png: a picture of uint8 colours; expected depth, a 16-bit grey ..."),
    "16-bit colours": (np.zeros((48, 64, 3), np.uint16),
                       "...2.png: a picture of uint16 colours; expected depth, a 16-bit grey ..."),
})
def test_another_kind_of_picture_is_no_damage(folder: Path, given: np.ndarray, rejected: Any) -> None:
    """A picture of another size or type raises an error instead of being skipped."""
    put(folder / "2.png", given)
    with rejected:
        list(open_folder(folder, GIVEN))


def test_the_packing_of_nyu(tmp_path: Path) -> None:
    image = pack_depth(np.full((480, 640), 700))
    for name in ("depth_1_0000001", "rgb_1_0000001"):
        put(tmp_path / f"{name}.png", image)
    recording = open_folder(tmp_path / "depth_1_*.png", CameraInfo(NYU))
    assert (recording.camera, recording.unit_mm, recording.count) == (NYU, 1, 1)
    assert [float(frame.depth.mean()) for frame in recording] == [700]


def tiff(path: Path, count: int) -> None:
    """Write a TIFF of several pictures."""
    cv2.imwritemulti(str(path), [hand_sized()] * count)


@bad_inputs(DataError, {
    "an empty folder": (((), ""), "...: holds no depth frames (16-bit grey PNG or TIFF)"),
    "other pictures": ((("a.jpg", "b.JPG", ".1.png"), ""),
                       "...: holds no depth frames (16-bit grey PNG or TIFF), but .jpg"),
    "folders": ((("depth/1.png", "rgb/1.png"), ""),
                "...: holds no depth frames (16-bit grey PNG or TIFF); depth, rgb in it do: name one"),
    "another pattern": ((("left_1.png",), "lefts_*.png"),
                        ".../lefts_*.png: no picture has such a name (did you mean 'left_1.png'?)"),
    "another name": ((("frames_a/1.png",), "frame_a"),
                     ".../frame_a: no such file or folder (did you mean 'frames_a'?)"),
    "a TIFF of two pictures": ((("1.tif",), ""),
                               ".../1.tif: a TIFF of 2 pictures; expected one for each frame, or all in an .npy"),
    "a camera of another size": ((("1.png",), "", 640), ".../1.png: 64 x 48 pixels; camera own has 640 x 48"),
})
def test_nothing_to_read(tmp_path: Path, given: tuple[tuple[str, ...], str] | Any, rejected: Any) -> None:
    """The error names what was found instead, before any frame is read."""
    names, source, *width = given
    for name in names:
        if name.endswith(".tif"):
            tiff(tmp_path / name, 2)
        else:
            put(tmp_path / name, hand_sized())
    with rejected:
        open_folder(tmp_path / source, replace(GIVEN, camera=replace(CAMERA, width=width[0])) if width else GIVEN)
