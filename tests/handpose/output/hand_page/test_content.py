"""handpose/output/hand_page/content.py"""

from __future__ import annotations

import base64

import numpy as np
import pytest

from handpose.frames.cameras import ICVL, KINECT2, NYU, Camera
from handpose.frames.crops import SIZE, crop
from handpose.output.hand_page.assembly import crop_points, hand
from layers.hand import skeleton as skeletons

HAND = skeletons.load()


@pytest.mark.parametrize("camera", [NYU, KINECT2, ICVL], ids=lambda camera: camera.name)
def test_points_are_where_the_camera_saw_them(camera: Camera) -> None:
    """Every pixel of the frame within the cube yields one point, as unprojected by the camera; no others do."""
    rng, uvd = np.random.default_rng(0), np.array([camera.u0 + 15, camera.v0 - 20, 800.0])
    frame = rng.uniform(500, 1100, (camera.height, camera.width)).astype(np.float32)
    frame[rng.random(frame.shape) < 0.3] = 0
    found = crop_points(crop(frame, uvd, 300.0, camera), uvd, 300.0, camera)
    pixels = camera.project(found + camera.unproject(uvd))
    columns, rows = (np.rint(pixels[:, i]).astype(int) for i in (0, 1))
    np.testing.assert_allclose(pixels[:, :2], np.stack([columns, rows], axis=1), atol=1e-6)
    np.testing.assert_allclose(pixels[:, 2], frame[rows, columns], atol=1e-3)
    assert len(np.unique(pixels[:, :2].round(), axis=0)) == len(found) > 1000
    assert (np.abs(found[:, 2]) < 150).all()


def test_a_crop_beside_the_image() -> None:
    uvd = np.array([3.0, 3, 700])
    frame = np.full((480, 640), 700, np.float32)
    found = crop_points(crop(frame, uvd, 300.0), uvd, 300.0, NYU)
    pixels = NYU.project(found + NYU.unproject(uvd))
    assert pixels[:, :2].min() == pytest.approx(0, abs=1e-6) and len(found) > 100
    assert crop_points(np.ones((SIZE, SIZE), np.float32), uvd, 300.0, NYU).shape == (0, 3)


@pytest.mark.parametrize("cube", [260.0, 30000.0])
def test_a_hand_as_values(cube: float) -> None:
    """Points and crop are stored in 16 bits for any size of the cube."""
    rng, uvd = np.random.default_rng(1), np.array([250.0, 200, 50.0 + cube])
    seen = rng.uniform(-1.2, 1, (SIZE, SIZE)).clip(-1, 1).astype(np.float32)
    made = hand("a.png", "a hand", np.zeros(47), camera=KINECT2, center_uvd=uvd,
                cube_mm=cube, crop=seen)
    points = np.frombuffer(base64.b64decode(made["points"]), "<i2").reshape(-1, 3) * made["step_mm"]
    np.testing.assert_allclose(points, crop_points(seen, uvd, cube, KINECT2), atol=made["step_mm"])
    assert made["step_mm"] <= cube / 30000 * 2
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(made["crop"]), "<i2") / 32767, seen.ravel(), atol=2e-5)
    assert made["place"]["unit_mm"] == cube / 2 and len(made["inputs"]) == 47
