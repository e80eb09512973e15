"""handpose/output/drawing/tracks.py"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from handpose.body.gestures import Gesture
from handpose.frames.cameras import CAMERAS, Camera
from handpose.output.drawing import hands
from handpose.output.drawing.strokes import Image
from handpose.output.drawing.tracks import HEAD, LOST_S, MAX_HEIGHT, MAX_WIDTH, Painter
from handpose.output.drawing.view import ViewportFollower, box_of, colour_of
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from tests.support.tracked_hands import CAMERA, HEADER, lost, present, seen, tracked, with_pose

RIGHT = tracked("right", (-120, 0, 600), 1, 0.93)
LEFT = tracked("left", (120, 0, 640), 2, 0.71)
DEPTH = seen([RIGHT, LEFT])
VIEW = ViewportFollower(CAMERA).see(1.0, [RIGHT, LEFT])  # of a first frame with both
ZOOM = MAX_HEIGHT / VIEW.height


def annotated(depth: np.ndarray, frame: TrackedFrame, header: TrackHeader = HEADER) -> Image:
    """The picture of a first frame."""
    return Painter(header).picture(depth, frame)


def of(*found: TrackedHand, time: float = 1.0) -> TrackedFrame:
    return TrackedFrame(30, time, found)


def where(one: Image, other: Image) -> tuple[slice, slice]:
    """The rectangle of rows and columns in which two pictures differ."""
    rows, columns = np.nonzero((one != other).any(axis=2))
    return slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)


def test_joints_are_where_the_camera_sees_them() -> None:
    """A fingertip has its finger's colour, or is hollow where the finger is a guess; a rectangle
    shows the crop.
    """
    guess = replace(RIGHT, finger_error_mm=np.array([10.0, 45, 12, 29, 8]))
    picture = annotated(DEPTH, of(guess, LEFT))[HEAD:]
    for hand, (finger, colour) in itertools.product((guess, LEFT), hands.FINGER_COLOURS.items()):
        u, v, _ = CAMERA.project(hand.xyz[HEADER.skeleton.joint_names.index(f"{finger}_tip")])
        x, y = (round((edge + 0.5) * ZOOM - 0.5) for edge in (u - VIEW.left, v - VIEW.top))
        assert tuple(picture[y, x]) == (
            hands.WHITE if hand is guess and finger == "index" else colour
        ), finger
    for hand in (RIGHT, LEFT):
        left, top, right, bottom = box_of(hand, CAMERA)
        for u, v in (
            (left, (top + 3 * bottom) / 4),
            ((left + 3 * right) / 4, bottom),
            (right, (top + 3 * bottom) / 4),
        ):
            x, y = (round(edge * ZOOM - 0.5) for edge in (u - VIEW.left, v - VIEW.top))
            np.testing.assert_allclose(picture[y, x].astype(int), colour_of(hand.id), atol=20)


def test_surface_lies_over_the_depth_that_it_explains() -> None:
    """The hand's pixels are skin-coloured, and nearly all others are unchanged."""
    without = with_pose(RIGHT, surface=None)
    depth = seen([RIGHT])
    bare, with_surface = (
        Painter(HEADER).seen(depth, of(hand)).astype(int) for hand in (without, RIGHT)
    )
    alone = depth < 1500
    changed = (bare != with_surface).any(axis=2)
    view = ViewportFollower(CAMERA).see(1.0, [RIGHT])
    x = np.floor(view.left + (np.arange(MAX_WIDTH) + 0.5) * view.width / MAX_WIDTH).astype(int)
    y = np.floor(view.top + (np.arange(MAX_HEIGHT) + 0.5) * view.height / MAX_HEIGHT).astype(int)
    hand = alone[y.clip(max=119)][:, x.clip(max=159)]
    assert changed[hand].mean() > 0.7  # bones cover the rest
    assert changed[~hand].mean() < 0.05  # the pixels at its edge
    blue, _, red = np.moveaxis(with_surface[changed & hand], -1, 0)
    assert (red > blue + 10).mean() > 0.9


def test_the_part_around_a_hand_is_shown() -> None:
    part = annotated(seen([RIGHT]), of(RIGHT))[HEAD:]
    assert np.array_equal(part, Painter(HEADER).seen(seen([RIGHT]), of(RIGHT)))
    whole = Painter(HEADER).seen(seen([RIGHT]), of())
    skin = [(one[..., 2].astype(int) > one[..., 0] + 10).mean() for one in (part, whole)]
    assert skin[0] > 0.08 and skin[1] == 0


def test_each_hand_has_its_label_in_its_colour() -> None:
    """Another confidence changes only the label on the depth image, which has the hand's colour."""
    picture = annotated(DEPTH, of(RIGHT, LEFT))[HEAD:]
    surer = annotated(DEPTH, of(replace(RIGHT, confidence=0.94), LEFT))[HEAD:]
    rows, columns = where(picture, surer)
    assert rows.stop - rows.start < 22 and columns.stop - columns.start < 100
    assert (picture[rows, columns] == colour_of(1)).all(axis=2).any()


def test_the_gesture_is_in_the_label() -> None:
    """Only the label is wider."""
    plain, shown = (
        Painter(HEADER).seen(DEPTH, of(hand, LEFT))
        for hand in (RIGHT, replace(RIGHT, gesture=Gesture("open", 0.9)))
    )
    rows, columns = where(plain, shown)
    assert rows.stop - rows.start <= 22 and columns.stop - columns.start < 100
    before, after = ((image == colour_of(1)).all(axis=2).sum() for image in (plain, shown))
    assert after > before


def test_a_lost_hand_is_said_to_be_lost_and_why() -> None:
    """The reason is written in the hand's colour in the lower left corner, and the
    hand is not drawn.
    """
    gone = lost(2, "left", 0.6, "left the image")
    picture = annotated(DEPTH, of(RIGHT, gone))[HEAD:]
    corner = picture[-22:, :200]
    assert (corner == colour_of(2)).all(axis=2).mean() > 0.3
    assert not (picture[:-22] == colour_of(2)).all(axis=2).any()
    other = replace(gone, reason="hidden by a nearer object")
    rows, columns = where(picture, annotated(DEPTH, of(RIGHT, other))[HEAD:])
    assert rows.start >= MAX_HEIGHT - 22 and columns.stop < 500


def test_a_lost_hand_is_listed_for_three_seconds() -> None:
    gone = lost(2, "left", 0.5)
    for time, is_listed in ((0.5 + LOST_S, True), (0.6 + LOST_S, False)):
        picture = annotated(DEPTH, of(RIGHT, gone, time=time))
        assert (picture == colour_of(2)).all(axis=2).any() == is_listed


def test_a_hand_without_joints_is_outlined_or_marked() -> None:
    """Its pixels are outlined in its colour; if they are unknown there is a circle
    about its middle.
    """
    mask = np.zeros((120, 160), bool)
    mask[40:80, 30:70] = True
    hand = present(2, 0.43, 0.0, place=(0.0, 0.0, 600.0), mask=mask)
    zoom = MAX_WIDTH / 160
    pictures = [annotated(DEPTH, of(one)) for one in (hand, replace(hand, mask=None))]
    coloured = [(picture[HEAD:] == colour_of(2)).all(axis=2) for picture in pictures]
    edge, inside = ((round(60 * zoom), round(column * zoom)) for column in (30, 50))
    assert coloured[0][edge[0], edge[1] - 3 : edge[1] + 4].any()
    assert not coloured[0][inside]
    u, v, _ = CAMERA.project(np.array([60.0, 0, 600])) * zoom
    assert coloured[1][round(v), round(u) - 6 : round(u) + 7].any()
    assert not coloured[0][round(v), round(u)]


def test_a_hand_that_the_finder_no_longer_sees_is_not_drawn() -> None:
    picture = annotated(DEPTH, of(present(2, 0.4, 0.0, is_seen=False)))
    assert np.array_equal(picture, annotated(DEPTH, of()))


def test_a_hand_partly_or_wholly_outside_the_image_is_harmless() -> None:
    for at in ((-330, 0, 600), (5000, 0, 600), (0, 0, 60)):
        hand = tracked("right", at)
        assert annotated(seen([]), of(hand)).shape == (HEAD + MAX_HEIGHT, MAX_WIDTH, 3)


@pytest.mark.parametrize(
    "camera", [*CAMERAS.values(), Camera("upright", 500, 500, 240, 320, 480, 640)], ids=str
)
def test_sizes(camera: Camera) -> None:
    """The depth image has the camera's aspect ratio, and reaches the largest width or height."""
    picture = annotated(
        np.full((camera.height, camera.width), 900, np.float32),
        of(),
        replace(HEADER, camera=camera),
    )
    height = picture.shape[0] - HEAD
    width = picture.shape[1]
    assert abs(width / height - camera.width / camera.height) < 0.01
    assert height <= MAX_HEIGHT
    assert width <= MAX_WIDTH
    assert height == MAX_HEIGHT or width == MAX_WIDTH
