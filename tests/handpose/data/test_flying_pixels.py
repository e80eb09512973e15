"""handpose/data/flying_pixels.py"""

from __future__ import annotations

import numpy as np

from handpose.data.flying_pixels import clear_crop, without_flying_pixels
from handpose.facts.cameras import KINECT2


def plate() -> np.ndarray:
    """A slanted plate, and a bar 45 mm before it, in a cube of 300 mm."""
    crop = np.ones((128, 128), np.float32)
    crop[30:100, 20:110] = np.linspace(0, 0.5, 90, dtype=np.float32)  # 0.8 mm from pixel to pixel
    crop[50:60] = np.where(crop[50:60] < 1, crop[50:60] - 0.3, 1)
    return crop


def test_clean_edges_stay() -> None:
    """What a camera reads right at edges is kept, before the background as before other surfaces."""
    np.testing.assert_array_equal(without_flying_pixels(plate(), 150.0, 1.5), plate())


def test_flying_pixels() -> None:
    """Depths between a surface and the background are removed, also two pixels wide."""
    crop = plate()
    crop[100, 20:110] = crop[99, 20:110] + 0.15
    crop[101, 20:110] = crop[99, 20:110] + 0.4
    np.testing.assert_array_equal(without_flying_pixels(crop, 150.0, 1.5), plate())


def test_between_two_surfaces() -> None:
    """A row at a depth between bar and plate is removed; its neighbours stay."""
    crop = plate()
    crop[60, 20:110] = (crop[59, 20:110] + crop[61, 20:110]) / 2
    found = without_flying_pixels(crop, 150.0, 1.5)
    assert (found[60, 20:110] == 1).all()
    np.testing.assert_array_equal(np.delete(found, 60, axis=0), np.delete(crop, 60, axis=0))


def test_wide_pixels() -> None:
    """Where pixels are 6 mm wide, 25 mm from one to the next are a slope."""
    ramp = np.ones((128, 128), np.float32)
    ramp[:, 40:80] = np.linspace(-0.9, 0.9, 40, dtype=np.float32)  # 7 mm
    ramp[:, 40:80:2] -= 0.06  # and steps of up to 16
    assert (without_flying_pixels(ramp, 150.0, 1.0)[:, 41:80] == 1).any()
    np.testing.assert_array_equal(without_flying_pixels(ramp, 150.0, 6.0), ramp)


def test_crop_of_a_frame() -> None:
    """``crop``, then without flying pixels: a disc whose rim reads halfway to the wall loses the rim."""
    depth = np.full((424, 512), 1500, np.float32)
    v, u = np.indices(depth.shape)
    far = np.hypot(u - 256, v - 212)
    depth[far < 30] = 600
    depth[(far >= 30) & (far < 31)] = 650
    found = clear_crop(depth, (256.0, 212.0, 600.0), 300.0, KINECT2)
    assert set(np.unique(found).tolist()) == {0.0, 1.0}
