"""handpose/frames/crops.py"""

from __future__ import annotations

from math import floor
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from handpose.body.nyu import CENTER_JOINT, CUBE_MM
from handpose.datasets.nyu_files import read_nyu_depth
from handpose.frames.cameras import CAMERAS, KINECT2, Camera
from handpose.frames.crops import (
    clear_crop,
    crop,
    crop_pixels,
    crop_scale,
    normalise_joints,
    restore_joints,
    unread,
    window,
    with_hidden,
    without_flying_pixels,
    without_isolated_near,
)


def cut_and_resize(
    depth: NDArray[np.float32], uvd: tuple[float, float, float], cube: float, camera: Camera
) -> NDArray[np.float32]:
    """The released preprocessing, step by step: cut the window, pad, clamp, resize with
    OpenCV, paste.
    """
    (u, v, d) = uvd
    h = cube / 2
    left, right = (floor((u * d / camera.fx + side) / d * camera.fx) for side in (-h, h))
    top, bottom = (floor((v * d / camera.fy + side) / d * camera.fy) for side in (-h, h))
    part = np.zeros((bottom - top, right - left), np.float32)
    rows, columns = np.arange(top, bottom), np.arange(left, right)
    r = (rows >= 0) & (rows < camera.height)
    c = (columns >= 0) & (columns < camera.width)
    part[np.ix_(r, c)] = depth[np.ix_(rows[r], columns[c])]
    part[(part != 0) & (part < d - h)] = d - h
    part[part > d + h] = d + h
    height, width = part.shape
    shape = (128, height * 128 // width) if width > height else (width * 128 // height, 128)
    small = cv2.resize(part, shape, interpolation=cv2.INTER_NEAREST)
    out = np.zeros((128, 128), np.float32)
    x, y = 64 - shape[0] // 2, 64 - shape[1] // 2
    out[y : y + shape[1], x : x + shape[0]] = small
    out[out == 0] = d + h
    return (out - np.float32(d)) / np.float32(h)


def test_the_published_crop(nyu_data: Path) -> None:
    """The crop of the first real test frame equals the crop published by the paper's authors,
    on every pixel.
    """
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][0, CENTER_JOINT]
    made = crop(read_nyu_depth(nyu_data / "depth_1_0000001.png"), uvd, CUBE_MM)
    published = cv2.imread(str(nyu_data / "crops" / "0.png"), cv2.IMREAD_GRAYSCALE)
    assert published is not None
    assert made.dtype == np.float32 and made.shape == (128, 128)
    assert_array_equal(np.rint((made + 1) / 2 * 255), published)


@settings(max_examples=60, deadline=None)
@given(
    camera=st.sampled_from([CAMERAS["nyu"], CAMERAS["icvl"], CAMERAS["kinect2"]]),
    across=st.floats(0, 1),
    down=st.floats(0, 1),
    d=st.floats(300, 1500),
    cube=st.sampled_from([200.0, 250.0, 261.0, 300.0]),
)
def test_same_as_cutting_and_resizing(
    camera: Camera, across: float, down: float, d: float, cube: float
) -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(d - cube, d + cube, (camera.height, camera.width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    uvd = (across * (camera.width - 1), down * (camera.height - 1), d)
    made = crop(depth, uvd, cube, camera)
    assert_allclose(made, cut_and_resize(depth, uvd, cube, camera), atol=2e-6)


def test_near_far_and_no_reading() -> None:
    """Depths nearer than the cube become -1, farther ones 1, the centre's depth 0; missing readings
    are background.
    """
    for reading, value in (
        (10, -1),
        (650, -1),
        (800, 0),
        (875, 0.5),
        (5000, 1),
        (0, 1),
        (np.nan, 1),
    ):
        depth = np.full((480, 640), reading)
        assert_allclose(crop(depth, (320, 240, 800), 300), value, atol=1e-7)


def test_window_is_square_in_space() -> None:
    """With a smaller fy the aspect is kept: the shorter side is padded equally on both ends."""
    wide = Camera("wide", 600.0, 300.0, 320.0, 240.0, 640, 480)
    columns, rows = window([[320, 240, 800]], 200, wide)
    assert (columns >= 0).all()
    assert_array_equal(np.flatnonzero(rows[0] >= 0), np.arange(32, 96))


@pytest.mark.parametrize("distance", [350, 600, 1000])
def test_crop_scale_is_half_a_pixel_before_the_window(distance: float) -> None:
    """``crop_scale`` is half a pixel less than the picked pixels on average; ``crop_pixels``
    corrects for it.
    """
    centers = np.stack(
        [np.linspace(200.1, 300.7, 37), np.full(37, 200.3), np.full(37, distance)], axis=1
    )
    columns = window(centers, 300.0).columns
    first, factor = crop_scale(centers, 300.0)
    n, i = np.nonzero(columns >= 0)
    scaled = first[n, 0] + factor[n, 0] * columns[n, i]
    assert (scaled - i).mean() == pytest.approx(-0.5, abs=0.04)
    uvd = np.stack([columns, columns, np.full_like(columns, distance)], axis=2).astype(float)
    assert_allclose(crop_pixels(uvd, centers, 300.0)[n, i, 0], scaled + 0.5)


def test_crop_pixels_undo_the_window() -> None:
    """``crop_pixels`` maps the image pixel shown at a crop pixel back to that crop pixel."""
    centers = np.array([[200.3, 150.8, 700.0], [320.0, 240.0, 1000.0]])
    columns, rows = window(centers, 300)
    uvd = np.stack([columns, rows, np.full_like(rows, 700)], axis=-1)
    at = crop_pixels(uvd, centers, 300)
    for axis, index in enumerate((columns, rows)):
        n, i = np.nonzero(index >= 0)
        assert len(i) > 250
        assert_allclose(at[n, i, axis], i, atol=0.51)


def test_joints_there_and_back() -> None:
    xyz = np.array(
        [[[10.0, 20.0, 800.0], [10.0, 20.0, 1100.0]], [[0.0, 0.0, 700.0], [130.5, 0.0, 700.0]]]
    )
    center, half = np.array([[10.0, 20.0, 800.0], [0.0, 0.0, 700.0]]), np.array([150.0, 130.5])
    joints = normalise_joints(xyz, center, half)
    assert_allclose(joints, [[[0, 0, 0], [0, 0, 2]], [[0, 0, 0], [1, 0, 0]]])
    assert_allclose(restore_joints(joints, center, half), xyz)


def plate() -> np.ndarray:
    """A slanted plate, with a bar 45 mm in front of it, in a cube of 300 mm."""
    crop = np.ones((128, 128), np.float32)
    crop[30:100, 20:110] = np.linspace(0, 0.5, 90, dtype=np.float32)  # 0.8 mm from pixel to pixel
    strip = crop[50:60]
    strip[strip < 1] -= 0.3
    return crop


def test_flying_pixels() -> None:
    """Behind an edge, and between two surfaces; correct readings at edges stay, and so do those
    around flying ones.
    """
    assert_array_equal(without_flying_pixels(plate(), 150.0, 1.5), plate())
    crop = plate()
    crop[100, 20:110] = crop[99, 20:110] + 0.15
    crop[101, 20:110] = crop[99, 20:110] + 0.4
    assert_array_equal(without_flying_pixels(crop, 150.0, 1.5), plate())
    crop = plate()
    crop[60, 20:110] = (crop[59, 20:110] + crop[61, 20:110]) / 2
    found = without_flying_pixels(crop, 150.0, 1.5)
    assert (found[60, 20:110] == 1).all()
    assert_array_equal(np.delete(found, 60, axis=0), np.delete(crop, 60, axis=0))


def test_wide_pixels() -> None:
    """For pixels 6 mm wide, a step of 25 mm between neighbours counts as a slope and is kept."""
    ramp = np.ones((128, 128), np.float32)
    ramp[:, 40:80] = np.linspace(-0.9, 0.9, 40, dtype=np.float32)  # 7 mm
    ramp[:, 40:80:2] -= 0.06  # plus steps of up to 16 mm
    assert (without_flying_pixels(ramp, 150.0, 1.0)[:, 41:80] == 1).any()
    assert_array_equal(without_flying_pixels(ramp, 150.0, 6.0), ramp)


def test_crop_of_a_frame() -> None:
    """``clear_crop`` removes the rim of a disc whose rim reads a depth between the
    disc and the wall.
    """
    depth = np.full((424, 512), 1500, np.float32)
    v, u = np.indices(depth.shape)
    far = np.hypot(u - 256, v - 212)
    depth[far < 30] = 600
    depth[(far >= 30) & (far < 31)] = 650
    found = clear_crop(depth, (256.0, 212.0, 600.0), 300.0, KINECT2)
    assert set(np.unique(found).tolist()) == {0.0, 1.0}


def test_isolated_near_readings() -> None:
    """Readings in front of the cube are background, unless they continue a surface that reaches
    the near face.
    """
    crop = plate()
    crop[5:20, 5:20] = -1
    assert_array_equal(without_isolated_near(crop, 150.0), plate())
    arm = plate()
    arm[30:100, 60:80] = np.clip(np.linspace(-1.5, 0.2, 70, dtype=np.float32), -1, 1)[:, None]
    assert_array_equal(without_isolated_near(arm, 150.0), arm)


def test_readings_in_front_of_the_cube_hide_the_hand() -> None:
    """They are at the near face, those nearer than the camera measures included."""
    depth = np.full((424, 512), 600, np.float32)
    depth[200:220, 250:260], depth[220:225, 250:260] = 40, 300
    center = (256.0, 212.0, 600.0)
    plain = clear_crop(KINECT2.in_range(depth), center, 300.0, KINECT2)
    hidden = with_hidden(plain, depth, center, 300.0, KINECT2)
    assert_array_equal(hidden == -1, crop(depth, center, 300.0, KINECT2) == -1)
    assert (hidden == -1).sum() > 100 and plain.min() == 0
    assert_array_equal(hidden[hidden > -1], plain[hidden > -1])
    assert with_hidden(plain, np.full_like(depth, 600), center, 300.0, KINECT2) is plain


def test_pixels_without_a_reading() -> None:
    """Only pixels within the image can lack a reading: those of 0 and of NaN."""
    depth = np.full((KINECT2.height, KINECT2.width), 600, np.float32)
    depth[:, 100:110], depth[:, 110:120] = 0, np.nan
    center = (100.0, 20.0, 600.0)
    found, shown = unread(depth, center, 300.0, KINECT2), crop(depth, center, 300.0, KINECT2)
    rows = window(np.array([center]), 300.0, KINECT2).rows[0]
    assert (rows < 0).any() and not found[rows < 0].any()
    assert_array_equal(found[rows >= 0], shown[rows >= 0] == 1)
