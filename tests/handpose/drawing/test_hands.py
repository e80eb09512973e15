"""handpose/draw.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose import draw
from handpose.camera import NYU
from handpose.crop import crop_pixels
from layers import kinematics
from netlib.errors import DataError

SKELETON = kinematics.load()
JOINTS = SKELETON.joints(np.zeros((1, 47)))[0]
EMPTY = np.ones((128, 128), np.float32)


def test_overlay_shows_joints_where_they_are_seen() -> None:
    """With the centre known, a joint's dot is at its pixel of the crop, in its finger's colour; else nearly so."""
    center = np.array([250.0, 200.0, 700.0])
    tip = SKELETON.joint_names.index("thumb_tip")
    uvd = NYU.project(JOINTS[tip] * 150 + NYU.unproject(center))
    u, v = np.rint(crop_pixels(uvd[None, None], center[None], 300.0)[0, 0] * 4 + 1.5).astype(int)
    picture = draw.overlay(EMPTY, JOINTS, SKELETON, center_uvd=center)
    assert picture.shape == (512, 512, 3) and picture.dtype == np.uint8
    assert tuple(picture[v, u]) == draw.COLOURS["thumb"]
    parallel = draw.overlay(EMPTY, JOINTS, SKELETON)
    near = parallel[v - 30 : v + 30, u - 30 : u + 30].reshape(-1, 3)
    assert (near == draw.COLOURS["thumb"]).all(axis=1).any()


def test_every_finger_has_its_colour() -> None:
    """Five fingers, five colours, and grey for the rest."""
    for picture in (draw.overlay(EMPTY, JOINTS, SKELETON), draw.view_3d(JOINTS, SKELETON)):
        shown = {tuple(int(c) for c in colour) for colour in np.unique(picture.reshape(-1, 3), axis=0)}
        assert {*draw.COLOURS.values(), draw.GREY} <= shown


def test_near_is_bright() -> None:
    """Background is black, the near face of the cube is the brightest."""
    crop = EMPTY.copy()
    crop[:, 100:] = -1
    picture = draw.overlay(crop, JOINTS * 0.01, SKELETON, zoom=2)
    assert picture.shape == (256, 256, 3)
    assert (picture[5, 5] == 0).all() and (picture[5, 250] > 200).all()


def test_truth_is_drawn_too() -> None:
    """A second skeleton adds white on the crop and leaves the first one's colours."""
    without = draw.overlay(EMPTY, JOINTS, SKELETON)
    both = draw.overlay(EMPTY, JOINTS, SKELETON, truth=JOINTS + 0.2)
    white = (both == 255).all(axis=2) & ~(without == 255).all(axis=2)
    assert white.sum() > 50
    assert not np.array_equal(draw.view_3d(JOINTS, SKELETON), draw.view_3d(JOINTS, SKELETON, truth=JOINTS + 0.2))


def test_joints_far_outside_do_no_harm() -> None:
    """A wild prediction is drawn as far as it fits."""
    draw.overlay(EMPTY, JOINTS * 1e9, SKELETON)
    draw.view_3d(JOINTS * 3, SKELETON)


def test_sheet() -> None:
    """Pictures of any size and depth are set in a grid, titles above them."""
    pictures = [np.full((60, 40), 10, np.uint8), np.full((30, 80, 3), 20, np.uint8), np.full((60, 80), 30, np.uint8)]
    page = draw.sheet(pictures, 2, ["one", "a title that is far too long for its cell", "three"])
    assert page.shape == (2 * (60 + 22 + 8) + 8, 2 * (80 + 8) + 8, 3)
    for value, picture in zip((10, 20, 30), pictures, strict=True):
        assert (page == value).all(axis=2).sum() >= picture.shape[0] * picture.shape[1]
    assert draw.sheet(pictures[:1], 4).shape == (60 + 16, 40 + 16, 3)


def test_mistakes() -> None:
    """Joints of another skeleton, NaN, an oblong crop and wrong titles are named."""
    for call, message in (
        (lambda: draw.overlay(EMPTY, np.zeros((14, 3)), SKELETON), r"\(14, 3\), expected \(31, 3\)"),
        (lambda: draw.view_3d(JOINTS * np.nan, SKELETON), "finite"),
        (lambda: draw.overlay(np.ones((10, 20)), JOINTS, SKELETON), r"\(10, 20\), expected a square"),
        (lambda: draw.sheet([EMPTY.astype(np.uint8)], 1, ["a", "b"]), "2 titles for 1"),
        (lambda: draw.sheet([], 1), "0 pictures"),
    ):
        with pytest.raises(DataError, match=message):
            call()
