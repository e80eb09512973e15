"""handpose/output/drawing/surface.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.capsules import Capsules
from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import NYU, Camera
from handpose.output.drawing import hands
from handpose.output.drawing.surface import over_crop, paint
from tests.support.packaged_hand import SKELETON


def test_surface_over_its_own_picture() -> None:
    """The surface is skin-coloured over the crop, reddish where nothing was seen; the rest of the
    crop is unchanged.
    """
    model, uvd = CapsuleModel(SKELETON, 150.0), np.array([[320.0, 240, 700]])
    x = np.zeros((1, model.variables))
    depth = render_crop(model.capsules(x, NYU.unproject(uvd)), uvd, 300.0)
    crop = normalise_depth(depth, uvd[:, 2], 300.0)[0]
    drawn = over_crop(crop, model.capsules(x, np.zeros((1, 3))), uvd, 300.0, NYU, zoom=2)
    assert drawn.shape == (256, 256, 3) and drawn.dtype == np.uint8
    surface = np.kron(crop < 1, np.ones((2, 2))) > 0
    blue, _, red = np.moveaxis(drawn.astype(int), -1, 0)
    assert (red[surface] > blue[surface] + 5).mean() > 0.95
    assert_array_equal(drawn[~surface], hands.picture(crop, 2)[~surface])
    alone = over_crop(
        np.ones_like(crop), model.capsules(x, np.zeros((1, 3))), uvd, 300.0, NYU, zoom=2
    )
    assert alone[surface][:, 1].mean() < 0.6 * drawn[surface][:, 1].mean()  # less green: red


BALL = Capsules(
    np.array([[[20.0, 10, 500]]]),
    np.array([[[20.0, 10, 500]]]),
    np.array([[60.0]]),
    np.array([[60.0]]),
)


@pytest.mark.parametrize("size", [100, 1000], ids=["every pixel", "one of many"])
def test_surface_is_painted_where_a_camera_sees_it(size: int) -> None:
    """A ball is drawn as a disc about its middle, lit from the upper left; the rest of the
    picture is unchanged.
    """
    camera = Camera("any", size, size, size / 2, size / 2, size, size)
    canvas = np.full((size, size, 3), 90, np.uint8)
    paint(canvas, BALL, camera)
    rows, columns = np.nonzero((canvas != 90).any(axis=2))
    u, v, _ = camera.project(BALL.a[0, 0])
    assert_allclose([columns.mean(), rows.mean()], [u, v], atol=0.004 * size + 0.5)
    assert_allclose(np.ptp(columns), 2 * 60 / 500 * size, rtol=0.04, atol=2)
    light = canvas.sum(axis=2)
    quarter = round(0.06 * size)
    middle_row, middle_column = round(v), round(u)
    assert (
        light[middle_row - quarter, middle_column - quarter]
        > light[middle_row + quarter, middle_column + quarter]
    )


def test_surface_outside_the_picture_or_behind_the_camera_is_not_painted() -> None:
    camera, canvas = Camera("any", 100, 100, 50, 50, 100, 100), np.zeros((100, 100, 3), np.uint8)
    for away in ((2000, 0, 0), (0, 0, -1000), (0, -2000, -480)):
        moved = BALL._replace(a=BALL.a + away, b=BALL.b + away)
        paint(canvas, moved, camera)
    assert not canvas.any()
