"""handpose/output/drawing/tracks.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.frames.cameras import CAMERAS, Camera
from handpose.output.drawing import hands
from handpose.output.drawing.strokes import Image
from handpose.output.drawing.tracks import HEAD, WIDTH, Painter
from handpose.output.drawing.view import Window, colour_of
from handpose.tracking.track import LostHand, TrackedFrame, TrackedHand, TrackHeader
from tests.support.tracked_hands import CAMERA, HEADER, seen, tracked

RIGHT = tracked("right", (-120, 0, 600), 1, 0.93)
LEFT = tracked("left", (120, 0, 640), 2, 0.71)
DEPTH = seen([RIGHT, LEFT])
VIEW = Window(CAMERA).see(1.0, [RIGHT, LEFT])  # of a first frame with both
ZOOM = 528 / VIEW.height


def annotated(depth: np.ndarray, frame: TrackedFrame, header: TrackHeader = HEADER, width: int = WIDTH) -> Image:
    """The picture of a first frame."""
    return Painter(header, width).picture(depth, frame)


def of(*found: TrackedHand, lost: tuple[LostHand, ...] = (), time: float = 1.0) -> TrackedFrame:
    return TrackedFrame(30, time, found, lost)


def where(one: Image, other: Image) -> tuple[slice, slice]:
    """The rectangle of rows and columns in which two pictures differ."""
    rows, columns = np.nonzero((one != other).any(axis=2))
    return slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)


@pytest.mark.parametrize("hand", [RIGHT, LEFT], ids=["right", "left"])
def test_joints_are_where_the_camera_sees_them(hand: TrackedHand) -> None:
    """The pixel of each fingertip has the finger's colour, for a right and a left hand."""
    picture = annotated(DEPTH, of(RIGHT, LEFT))[HEAD:]
    for finger, colour in hands.COLOURS.items():
        u, v, _ = CAMERA.project(hand.xyz[HEADER.skeleton.joint_names.index(f"{finger}_tip")])
        x, y = (round((edge + 0.5) * ZOOM - 0.5) for edge in (u - VIEW.left, v - VIEW.top))
        assert tuple(picture[y, x]) == colour, finger


def test_a_finger_that_is_a_guess_is_hollow() -> None:
    """Its tip is white on the depth, and in space there is white in the hand."""
    guess = replace(RIGHT, finger_error_mm=np.array([10.0, 45, 12, 29, 8]))
    pictures = [annotated(DEPTH, of(hand, LEFT))[HEAD:] for hand in (RIGHT, guess)]
    for finger, colour in hands.COLOURS.items():
        u, v, _ = CAMERA.project(RIGHT.xyz[HEADER.skeleton.joint_names.index(f"{finger}_tip")])
        x, y = (round((edge + 0.5) * ZOOM - 0.5) for edge in (u - VIEW.left, v - VIEW.top))
        assert tuple(pictures[1][y, x]) == (hands.WHITE if finger == "index" else colour)
    rows, columns = where(*pictures)
    assert columns.start < 704 < columns.stop and rows.stop <= 528


def test_surface_lies_over_the_depth_that_it_explains() -> None:
    """The hand's pixels are skin-coloured, and nearly all others are unchanged."""
    without = replace(RIGHT, capsules=None)
    rows, columns = slice(HEAD, HEAD + 528), slice(0, 704)
    depth = seen([RIGHT])
    bare, with_surface = (annotated(depth, of(hand))[rows, columns].astype(int) for hand in (without, RIGHT))
    alone = depth < 1500
    changed = (bare != with_surface).any(axis=2)
    view = Window(CAMERA).see(1.0, [RIGHT])
    across, down = view.left + (np.arange(704) + 0.5) * view.width / 704, (np.arange(528) + 0.5) * view.height / 528
    x, y = np.floor(across).astype(int), np.floor(view.top + down).astype(int)
    hand = alone[y.clip(max=119)][:, x.clip(max=159)]
    assert changed[hand].mean() > 0.7  # bones cover the rest
    assert changed[~hand].mean() < 0.05  # the pixels at its edge
    blue, _, red = np.moveaxis(with_surface[changed & hand], -1, 0)
    assert (red > blue + 10).mean() > 0.9


def test_the_part_around_a_hand_is_shown() -> None:
    """The picture shows the hand large."""
    painter = Painter(HEADER)
    picture = painter.picture(seen([RIGHT]), of(RIGHT))
    part = picture[painter.depth_part]
    assert part.shape == (528, 704, 3) and np.array_equal(part, Painter(HEADER).seen(seen([RIGHT]), of(RIGHT)))
    whole = Painter(HEADER).seen(seen([RIGHT]), of())
    skin = [(one[..., 2].astype(int) > one[..., 0] + 10).mean() for one in (part, whole)]
    assert skin[0] > 0.08 and skin[1] == 0


def test_each_hand_has_its_label_in_its_colour() -> None:
    """Another confidence changes only the label on the depth image, which has the hand's colour."""
    picture = annotated(DEPTH, of(RIGHT, LEFT))[HEAD : HEAD + 528]
    surer = annotated(DEPTH, of(replace(RIGHT, confidence=0.94), LEFT))[HEAD : HEAD + 528]
    rows, columns = where(picture, surer)
    assert rows.stop - rows.start < 22 and columns.stop - columns.start < 100
    assert (picture[rows, columns] == colour_of(1)).all(axis=2).any()
    unknown = annotated(DEPTH, of(replace(RIGHT, confidence=np.nan), LEFT))
    assert unknown.shape == (HEAD + 528, 1280, 3)


def test_a_lost_hand_is_said_to_be_lost_and_why() -> None:
    """The reason is written in the hand's colour in the lower left corner, and the hand is not drawn."""
    lost = LostHand(2, "left", 0.6, "left the image")
    picture = annotated(DEPTH, of(RIGHT, lost=(lost,)))[HEAD : HEAD + 528, :704]
    corner = picture[-22:, :200]
    assert (corner == colour_of(2)).all(axis=2).mean() > 0.3
    assert not (picture[:-22] == colour_of(2)).all(axis=2).any()
    other = lost._replace(reason="hidden by a nearer object")
    rows, columns = where(picture, annotated(DEPTH, of(RIGHT, lost=(other,)))[HEAD : HEAD + 528, :704])
    assert rows.start >= 528 - 22 and columns.stop < 500


def test_a_hand_partly_or_wholly_beside_the_image_does_no_harm() -> None:
    """Hands partly or entirely outside the image, or near the camera, are drawn without error."""
    for at in ((-330, 0, 600), (5000, 0, 600), (0, 0, 60)):
        hand = tracked("right", at)
        assert annotated(seen([]), of(hand)).shape == (HEAD + 528, 1280, 3)


@pytest.mark.parametrize("camera", [*CAMERAS.values(), Camera("upright", 500, 500, 240, 320, 480, 640)], ids=str)
def test_sizes(camera: Camera) -> None:
    """The picture has the requested width and an even height, and 2 of 5 of the width are left for the space view."""
    header = replace(HEADER, camera=camera)
    depth = np.full((camera.height, camera.width), 900, np.float32)
    picture, seen_alone = annotated(depth, of(), header), Painter(header).seen(depth, of())
    assert picture.shape[1] == 1280 and picture.shape[0] % 2 == 0 and 400 < picture.shape[0] <= 560
    assert seen_alone.shape[1] <= 768
    assert abs(seen_alone.shape[1] / seen_alone.shape[0] - camera.width / camera.height) < 0.01
    assert annotated(depth, of(), header, width=640).shape[1] == 640
