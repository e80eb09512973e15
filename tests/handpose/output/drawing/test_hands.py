"""handpose/output/drawing/hands.py"""

from __future__ import annotations

import numpy as np

from handpose.frames.cameras import NYU
from handpose.frames.crops import crop_pixels
from handpose.output.drawing import hands
from handpose.output.drawing.strokes import Image
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of

SKELETON = skeleton.load()
JOINTS = kinematics_of(SKELETON).joints(np.zeros((1, 47)))[0]
EMPTY = np.ones((128, 128), np.float32)
CENTER = np.array([250.0, 200.0, 700.0])
TIP = NYU.project(JOINTS[SKELETON.joint_names.index("thumb_tip")] * 150 + NYU.unproject(CENTER))
# its pixel
U, V = np.rint(crop_pixels(TIP[None, None], CENTER[None], 300.0)[0, 0] * 4 + 1.5).astype(int)


def colours_in(picture: Image) -> set[tuple[int, ...]]:
    return {tuple(colour) for colour in np.unique(picture.reshape(-1, 3), axis=0).tolist()}


def test_overlay_shows_joints_where_they_are_seen() -> None:
    """With a known centre, a joint's dot is at its pixel in the crop, in its finger's colour;
    otherwise near it.
    """
    picture = hands.overlay(EMPTY, JOINTS, SKELETON, center_uvd=CENTER)
    assert picture.shape == (512, 512, 3) and picture.dtype == np.uint8
    assert tuple(picture[V, U]) == hands.FINGER_COLOURS["thumb"]
    parallel = hands.overlay(EMPTY, JOINTS, SKELETON)
    assert hands.FINGER_COLOURS["thumb"] in colours_in(parallel[V - 30 : V + 30, U - 30 : U + 30])


def test_every_finger_has_its_colour() -> None:
    for picture in (hands.overlay(EMPTY, JOINTS, SKELETON), hands.view_3d(JOINTS, SKELETON)):
        assert {*hands.FINGER_COLOURS.values(), hands.GREY} <= colours_in(picture)


def test_a_guessed_finger_is_drawn_hollow() -> None:
    """A finger that is a guess is white with a rim in its colour; the others keep theirs."""
    assert hands.guessed(np.array([30.0, 31, np.nan, 60, 2])) == ["index", "ring"]
    picture = hands.overlay(EMPTY, JOINTS, SKELETON, center_uvd=CENTER, guesses=["thumb"])
    assert tuple(picture[V, U]) == hands.WHITE
    # the rim is one pixel wide, between white and black
    for colour in hands.FINGER_COLOURS.values():
        assert (np.abs(picture.astype(int) - colour).max(axis=2) < 40).sum() > 20
    solid, hollow = (hands.view_3d(JOINTS, SKELETON, guesses=some) for some in ((), ["index"]))
    assert (hollow == 255).all(axis=2).sum() > (solid == 255).all(axis=2).sum() + 50


def test_near_is_bright() -> None:
    """The background is black, and the near face of the cube is the brightest."""
    crop = EMPTY.copy()
    crop[:, 100:] = -1
    picture = hands.overlay(crop, JOINTS * 0.01, SKELETON, zoom=2)
    assert picture.shape == (256, 256, 3)
    assert (picture[5, 5] == 0).all() and (picture[5, 250] > 200).all()


def test_truth_is_drawn_too() -> None:
    """A second skeleton adds white on the crop and leaves the first one's colours."""
    without = hands.overlay(EMPTY, JOINTS, SKELETON)
    both = hands.overlay(EMPTY, JOINTS, SKELETON, truth=JOINTS + 0.2)
    white = (both == 255).all(axis=2) & ~(without == 255).all(axis=2)
    assert white.sum() > 50
    assert not np.array_equal(
        hands.view_3d(JOINTS, SKELETON), hands.view_3d(JOINTS, SKELETON, truth=JOINTS + 0.2)
    )


def test_joints_far_outside_the_picture_are_harmless() -> None:
    wild = JOINTS * 1e9
    tip = SKELETON.joint_names.index("index_tip")
    wild[tip] = 0
    picture = hands.overlay(EMPTY, wild, SKELETON)
    assert picture.shape == (512, 512, 3)
    assert tuple(picture[257, 257]) == hands.FINGER_COLOURS["index"]
    assert (picture == 0).all(axis=2).mean() > 0.9  # except for the bones, which cross it
    assert (hands.overlay(EMPTY, JOINTS * 1e9 + 1e9, SKELETON) == 0).all(), "all beside the picture"
    far, near = hands.view_3d(JOINTS * 3, SKELETON), hands.view_3d(JOINTS, SKELETON)
    assert far.shape == near.shape
    assert hands.GREY in colours_in(far) and not np.array_equal(far, near)
