"""handpose/frames/images.py; more of it in the tests of tools/predict.py"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.frames import images
from handpose.frames.cameras import KINECT2, NYU, Camera
from handpose.frames.images import BadFrameError, UnitError, check_unit, depth_image
from handpose.frames.lens import Lens, Undistorter
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError


def test_png_that_is_not_whole(tmp_path: Path) -> None:
    """A PNG file that is truncated at any place, or has one wrong byte, is rejected before it is decoded."""
    image = np.random.default_rng(0).integers(0, 65536, (40, 30)).astype(np.uint16)
    raw = cv2.imencode(".png", image)[1].tobytes()
    path = tmp_path / "image.png"
    path.write_bytes(raw + b"more")
    np.testing.assert_array_equal(images.read_png(path), image)
    broken = [raw[:cut] for cut in (0, 7, 8, 20, 100, len(raw) // 2, len(raw) - 12, len(raw) - 1)]
    for at in (3, 20, 60, len(raw) // 2, len(raw) - 5):
        broken.append(raw[:at] + bytes([raw[at] ^ 1]) + raw[at + 1 :])
    for data in broken:
        path.write_bytes(data)
        with pytest.raises(BadFrameError, match="truncated, damaged or no PNG"):
            images.read_png(path)
    with pytest.raises(BadFrameError, match="no such file"):
        images.read_png(tmp_path / "other.png")
    with pytest.raises(BadFrameError, match=r"truncated, damaged or no PNG \(cannot read the frame: Is a directory"):
        images.read_png(tmp_path)


def test_a_truncated_picture_of_a_user(tmp_path: Path) -> None:
    """A truncated picture is rejected instead of being filled up; other formats than PNG are read as well."""
    image = np.random.default_rng(0).integers(0, 256, (40, 30)).astype(np.uint8)
    raw = cv2.imencode(".png", image)[1].tobytes()
    path = tmp_path / "image.png"
    path.write_bytes(raw[: len(raw) * 3 // 4])
    with pytest.raises(DataError, match=r"image\.png: truncated or damaged"):
        images.read_picture(path)
    path.write_bytes(cv2.imencode(".bmp", image)[1].tobytes())
    assert (images.read_picture(path).reshape(40, 30, -1)[..., 0] == image).all()
    path.write_bytes(b"")
    with pytest.raises(DataError, match="not an image that OpenCV can decode"):
        images.read_picture(path)


def test_a_picture_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture is decoded only once, also a frame in NYU's colour packing."""
    depth = np.random.default_rng(0).integers(0, 3000, (480, 640))
    cv2.imwrite(str(tmp_path / "frame.png"), images.pack_depth(depth))
    decode, calls = cv2.imdecode, []
    monkeypatch.setattr(cv2, "imdecode", lambda *args: calls.append(1) or decode(*args))
    np.testing.assert_array_equal(images.read_frame(tmp_path / "frame.png", CameraInfo(NYU)), depth)
    assert len(calls) == 1


def test_frames_of_cameras_without_a_size(tmp_path: Path) -> None:
    """A camera without a size accepts frames of any size; otherwise the size must match the camera's."""
    cv2.imwrite(str(tmp_path / "frame.png"), np.full((30, 40), 500, np.uint16))
    own = Camera("own", 300.0, 300.0, 20.0, 15.0, 0, 0)
    assert (images.read_frame(tmp_path / "frame.png", CameraInfo(own, unit_mm=0.5)) == 250).all()
    with pytest.raises(DataError, match="40 x 30 pixels; camera kinect2 has 512 x 424"):
        images.read_frame(tmp_path / "frame.png", CameraInfo(KINECT2))


def test_a_frame_with_distortion_and_exchanged_bytes(tmp_path: Path) -> None:
    """A frame is read like one of a recording: the lens and the byte order are corrected."""
    depth = np.random.default_rng(0).integers(300, 900, (30, 40)).astype(np.uint16)
    camera, lens = Camera("own", 30.0, 30.0, 19.5, 14.5, 40, 30), Lens((-0.1, 0.02, 0, 0))
    cv2.imwrite(str(tmp_path / "frame.png"), depth.byteswap())
    found = images.read_frame(tmp_path / "frame.png", CameraInfo(camera, lens, 0.5, swap_bytes=True))
    np.testing.assert_array_equal(found, Undistorter(camera, lens)(depth.astype(np.float32) / 2))
    with pytest.raises(DataError, match=r"frame\.png: the camera of these frames is unknown"):
        images.read_frame(tmp_path / "frame.png", CameraInfo())


def test_depth_packed_in_colours() -> None:
    """Whole mm survive packing and unpacking; the green channel counts units of 256 mm."""
    depth = np.array([[0, 1, 255], [256, 773, 65535]])
    pixels = images.pack_depth(depth)
    assert pixels[1, 1].tolist() == [5, 3, 0]
    np.testing.assert_array_equal(images.unpack_depth(pixels), depth)


def test_what_is_masked_was_not_read() -> None:
    """Masked pixels become 0; an array without a mask is returned unchanged."""
    image = np.array([[700, 0], [65535, 800]], np.uint16)
    assert depth_image(image) is image
    assert depth_image(np.ma.masked_equal(image, 65535)).tolist() == [[700, 0], [0, 800]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([[700.0]], "depth image is a list, expected an array of numbers"),
        ("frame.png", "depth image is a str, expected an array of numbers"),
        (np.array([["a"]]), "depth image is an array of <U1, expected numbers"),
        (np.zeros((2, 2), complex), "depth image is an array of complex128, expected numbers"),
        (np.zeros((2, 2, 1)), r"depth image of shape \(2, 2, 1\), expected \(height, width\)"),
    ],
)
def test_what_is_no_image(given: object, message: str) -> None:
    """An invalid depth image raises an error with its type or shape."""
    with pytest.raises(DataError, match=message):
        depth_image(given)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.array([[0.5, 0, np.nan, 1.2]]), r"depths from 0\.5 to 1\.2, expected mm; they may be metres"),
        (np.array([[700000.0, 0]]), "depths from 700000 to 700000, expected mm, nearer than 20000"),
        (np.array([[-700, 0]], np.int16), "depths from -700 to -700, expected mm, growing away from the camera"),
    ],
)
def test_other_units(image: np.ndarray, message: str) -> None:
    """An error is raised if all depths suggest another unit than mm, and none if one depth is plausible."""
    with pytest.raises(UnitError, match=message):
        check_unit(image)
    check_unit(np.append(image, 700.0))


@pytest.mark.parametrize("unread", [0, -1, np.nan, np.inf])
def test_nothing_read(unread: float) -> None:
    """An image without readings passes the check of units."""
    check_unit(np.full((2, 2), unread))
