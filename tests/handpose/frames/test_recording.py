"""handpose/frames/recording.py: depth from stored values, and which source of parameters
takes precedence.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from handpose.frames.cameras import KINECT2, NYU, SR305
from handpose.frames.formats import open_recording
from handpose.frames.lens import Lens, Undistorter
from handpose.frames.recording import RATE_UNKNOWN, UNKNOWN, CameraInfo, DepthDecoder, stored
from tests.handpose.frames.conftest import CAMERA, hand_sized

U16 = np.dtype(np.uint16)


def decode(raw: np.ndarray, unit_mm: float = 0.5) -> np.ndarray:
    """Depth of a camera without a lens."""
    given = CameraInfo(replace(CAMERA, width=0, height=0), unit_mm=unit_mm)
    return DepthDecoder(raw.shape, raw.dtype, "take", given)(raw)


@pytest.mark.parametrize("dtype", [np.uint16, ">u2", np.int32, np.uint64, np.float32, np.float64])
def test_depth_is_in_mm(dtype: str) -> None:
    depth = decode(np.array([[0, 1, 65]], dtype))
    assert depth.dtype == np.float32
    assert_array_equal(depth, [[0, 0.5, 32.5]])


def test_invalid_depth_values_become_0() -> None:
    values = np.array([[np.nan, np.inf, -np.inf, 1e300, 2]])
    assert_array_equal(decode(values), [[0, 0, 0, 0, 1]])


def test_the_lens_is_taken_out() -> None:
    lens, raw = Lens((0.3, 0, 0, 0)), hand_sized()
    expected = Undistorter(CAMERA, lens)(raw.astype(np.float32))
    assert_array_equal(
        DepthDecoder(raw.shape, U16, "take", CameraInfo(CAMERA, lens, 1.0))(raw), expected
    )


@given(
    st.lists(st.integers(0, 65535), min_size=1, max_size=50),
    st.sampled_from([0.1, 0.125, 0.25, 1 / 3, 1, 5]),
)
def test_stored_is_the_inverse(values: list[int], unit_mm: float) -> None:
    """Every 16-bit value is restored, in any unit."""
    raw = np.array([values], np.uint16)
    assert_array_equal(stored(decode(raw, unit_mm), unit_mm, "take"), raw)


def test_values_of_the_user_take_precedence() -> None:
    own = CameraInfo(SR305, unit_mm=0.25)
    beside = CameraInfo(CAMERA, unit_mm=2.0, rate=5.0, origin="camera.json")
    shape = (SR305.height, SR305.width)
    found = DepthDecoder(shape, U16, "take", CameraInfo(unit_mm=3.0), own, beside)
    assert (found.camera, found.unit_mm, found.rate, found.remarks) == (SR305, 3.0, 5.0, ())
    assert DepthDecoder(shape, U16, "take", UNKNOWN, own, beside).unit_mm == 0.25


def test_the_unit_of_a_known_camera() -> None:
    """The unit is that of the camera's images unless another is given; a camera's name alone
    is not enough.
    """
    given = CameraInfo(SR305, origin="--camera")
    found = DepthDecoder((480, 640), U16, "take", given)
    assert found.unit_mm == 0.125 and found.remarks == ("camera sr305, by --camera",)
    assert DepthDecoder((480, 640), U16, "take", CameraInfo(SR305)).remarks == ("camera sr305",)
    stranger = CameraInfo(replace(SR305, fx=500.0), origin="--camera")
    found = DepthDecoder((480, 640), U16, "take", stranger)
    assert found.unit_mm == 1 and "unit unknown: a value of 1 is taken for 1 mm" in found.remarks[1]


def test_the_users_camera_replaces_the_lens_of_the_file() -> None:
    """A remark reports it."""
    own = CameraInfo(CAMERA, Lens((0.3, 0, 0, 0)), 1.0)
    found = DepthDecoder((48, 64), U16, "take", CameraInfo(CAMERA), own)
    assert found.lens is None and "the distortion in take is of another camera" in found.remarks[0]
    found = DepthDecoder((48, 64), U16, "take", UNKNOWN, own)
    assert found.lens == own.lens and found.remarks == ("the distortion of the lens is taken out",)


def test_frames_without_times(tmp_path: Path) -> None:
    """30 frames per second are assumed, with a warning, unless a rate is given."""
    path = tmp_path / "a.npy"
    np.save(path, np.ones((2, 48, 64), np.uint16))
    for rate, expected in ((None, 30), (60.0, 60)):
        found = open_recording(path, CameraInfo(CAMERA, unit_mm=1.0, rate=rate))
        assert found.rate == expected
        assert (RATE_UNKNOWN in found.remarks) == (rate is None)


LENS = Lens((0.1, 0, 0, 0))


def test_unknown_parameters_are_filled_in() -> None:
    assert CameraInfo(NYU, unit_mm=0.5).or_else(
        CameraInfo(KINECT2, None, 1.0, 30.0, "a file")
    ) == CameraInfo(NYU, None, 0.5, 30.0, "a file")
    assert UNKNOWN.or_else(CameraInfo(NYU, LENS, 1.0, 30.0, "a file")) == CameraInfo(
        NYU, LENS, 1.0, 30.0, "a file"
    )
    assert CameraInfo(NYU).or_else(UNKNOWN) == CameraInfo(NYU)


def test_a_lens_belongs_to_its_camera() -> None:
    """Another camera does not get the first one's lens; a lens alone applies to any camera."""
    assert CameraInfo(NYU).or_else(CameraInfo(KINECT2, LENS)).lens is None
    assert CameraInfo(lens=LENS).or_else(CameraInfo(KINECT2)) == CameraInfo(KINECT2, LENS)
