"""handpose/frames/images.py"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.frames import images
from handpose.frames.cameras import NYU, SR305
from handpose.frames.images import BadFrameError, check_unit, depth_image, without_dropouts
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.support.nyu_data_set import pack_depth


def test_a_truncated_or_damaged_png_is_rejected(here: Path, rng: np.random.Generator) -> None:
    """It may be truncated at any place, or have one wrong byte; it is rejected before it is
    decoded.
    """
    image = rng.integers(0, 65536, (40, 30)).astype(np.uint16)
    raw = cv2.imencode(".png", image)[1].tobytes()
    path = Path("image.png")
    path.write_bytes(raw + b"more")
    assert_array_equal(images.read_png(path), image)
    broken = [raw[:cut] for cut in (0, 7, 8, 20, 100, len(raw) // 2, len(raw) - 12, len(raw) - 1)]
    for at in (3, 20, 60, len(raw) // 2, len(raw) - 5):
        broken.append(raw[:at] + bytes([raw[at] ^ 1]) + raw[at + 1 :])
    for data in broken:
        path.write_bytes(data)
        with pytest.raises(BadFrameError, match=r"image\.png: truncated, damaged or no PNG$"):
            images.read_png(path)


def test_other_formats_than_png(here: Path, rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (40, 30)).astype(np.uint8)
    path = Path("image.png")
    path.write_bytes(cv2.imencode(".bmp", image)[1].tobytes())
    assert (images.read_picture(path).reshape(40, 30, -1)[..., 0] == image).all()


def test_the_packing_of_nyu(here: Path, rng: np.random.Generator) -> None:
    depth = rng.integers(0, 3000, (480, 640))
    cv2.imwrite("frame.png", pack_depth(depth))
    assert_array_equal(images.read_frame("frame.png", CameraInfo(NYU)), depth)


def test_units_of_a_frame(here: Path) -> None:
    """The default unit of SR305 is 0.125 mm."""
    cv2.imwrite("frame.png", np.full((480, 640), 8000, np.uint16))
    for unit, depth in ((None, 1000), (0.1, 800)):
        assert (images.read_frame("frame.png", CameraInfo(SR305, unit_mm=unit)) == depth).all()


def test_crops_are_normalised(here: Path) -> None:
    """Gray 0 is the near plane -1, 255 the far plane 1; other sizes are resized by
    nearest neighbour.
    """
    image = np.kron(np.array([[0, 255]] * 2, np.uint8), np.ones((32, 32), np.uint8))
    cv2.imwrite("crop.png", image)
    crop = images.read_crop("crop.png")
    assert crop.shape == (128, 128)
    assert (crop[:, :64] == -1).all()
    assert (crop[:, 64:] == 1).all()


def test_masked_pixels_become_0() -> None:
    """An array without a mask is returned unchanged."""
    image = np.array([[700, 0], [65535, 800]], np.uint16)
    assert depth_image(image) is image
    assert depth_image(np.ma.masked_equal(image, 65535)).tolist() == [[700, 0], [0, 800]]


@pytest.mark.parametrize("dtype", [np.float16, np.float32, ">f8"])
def test_nan_and_infinite_readings_become_0(dtype: str) -> None:
    image = np.array([[700, np.nan], [np.inf, -np.inf]], dtype)
    found = depth_image(image)
    assert found.tolist() == [[700, 0], [0, 0]] and found.dtype == image.dtype.newbyteorder("=")


@pytest.mark.parametrize(
    ("image", "what"),
    [
        (np.zeros((0, 3)), r"of shape \(0, 3\), expected \(height, width\)"),
        (np.zeros((2, 2), np.uint8), "values of type uint8; expected depths, of 16 bits or more"),
        (np.ones((2, 2), bool), "values of type bool"),
    ],
)
def test_arrays_that_are_no_depth_are_rejected(image: np.ndarray, what: str) -> None:
    with pytest.raises(DataError, match=what):
        depth_image(image)


@pytest.mark.parametrize(
    "image", [np.array([[0.5, 0, np.nan, 1.2]]), np.array([[700000.0, 0]]), np.array([[-700, 0]])]
)
def test_one_plausible_depth(image: np.ndarray) -> None:
    """Depths that suggest another unit than mm are no error if one depth is plausible."""
    check_unit(np.append(image, 700.0))


@pytest.mark.parametrize("unread", [0, -1, np.nan, np.inf])
def test_a_frame_without_readings_passes_the_check_of_its_unit(unread: float) -> None:
    check_unit(np.full((2, 2), unread))


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_single_missing_pixels_of_a_surface_are_filled(dtype: type) -> None:
    """Holes of one or two pixels get the median of their neighbours; gaps and edges
    stay as they are.
    """
    image = np.tile(np.arange(500, 512, dtype=dtype), (12, 1))
    image[:, :2] = 0
    image[4:, 6] = 0  # a gap
    whole = image.copy()
    for pixel in ((2, 9), (7, 9), (7, 10)):
        image[pixel] = 0
    filled = without_dropouts(image)
    assert filled.dtype == image.dtype
    end = [(4, 6)]  # of the gap: it has one missing neighbour, like a pixel of the pair
    for pixel in (*end, (2, 9), (7, 9), (7, 10)):
        assert abs(float(filled[pixel]) - (500 + pixel[1])) <= 1
        filled[pixel] = whole[pixel]
    assert np.array_equal(filled, whole)


def test_single_pixels_of_other_images() -> None:
    """Without one the image is not copied, also if its background has no readings; NaN counts
    as no reading.
    """
    image = np.zeros((9, 9), np.uint16)
    image[2:7, 2:7] = 400
    assert without_dropouts(image) is image
    image = np.full((5, 5), 400.0)
    image[2, 2] = np.nan
    assert (without_dropouts(image) == 400).all()
