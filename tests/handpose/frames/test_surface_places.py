"""handpose/frames/places.py"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.cameras import NYU
from handpose.frames.crops import crop
from handpose.frames.places import (
    BEHIND_MM,
    CUBE_MM,
    FAR_MM,
    MIN_DEPTH_MM,
    SIZE,
    VOXEL_MM,
    extent_around,
    place_crops,
    surface_places,
)
from netlib.errors import DataError


def plate(z: float = 700) -> np.ndarray:
    """A plate of 300 x 200 pixels without background."""
    depth = np.zeros((480, 640))
    depth[100:300, 200:500] = z
    return depth


def test_places_lie_on_the_surface() -> None:
    """Places cover the whole surface, about a voxel apart, at a small distance behind it."""
    places = surface_places(plate(), NYU)
    np.testing.assert_allclose(places[:, 2], 700 + BEHIND_MM)
    u, v, _ = NYU.project(places).T
    assert (u > 199).all() and (u < 500).all() and (v > 99).all() and (v < 300).all()
    width, height = 300 * 700 / NYU.fx, 200 * 700 / NYU.fy
    assert 0.8 < len(places) / (width * height / VOXEL_MM**2) < 2
    surface = np.stack(np.meshgrid(np.linspace(200, 499, 20), np.linspace(100, 299, 20)), axis=-1).reshape(-1, 2)
    points = NYU.unproject(np.column_stack([surface, np.full(400, 700.0)]))
    nearest = np.linalg.norm(points[:, None] - places, axis=2).min(axis=1)
    assert nearest.max() < VOXEL_MM


def test_what_is_no_place() -> None:
    """Missing readings, surfaces too far away and specks have no places."""
    assert surface_places(np.zeros((480, 640)), NYU).shape == (0, 3)
    assert surface_places(np.full((480, 640), np.nan), NYU).shape == (0, 3)
    assert surface_places(plate(FAR_MM + 1), NYU).shape == (0, 3)
    speck = np.zeros((480, 640))
    speck[200:206, 300:306] = 700
    assert surface_places(speck, NYU).shape == (0, 3)


def test_crops_of_places() -> None:
    """Only places in sight have crops; the crop shows the plate's depth in half-cubes from the place."""
    places = np.array([[0.0, 0, 720], [5000, 0, 720], [0, 0, 50]])
    crops, kept = place_crops(plate(), places, NYU)
    np.testing.assert_array_equal(kept, places[:1])
    assert crops.shape == (1, SIZE, SIZE) and crops.dtype == np.float32
    np.testing.assert_allclose(crops[0, SIZE // 2, SIZE // 2], -20 / (CUBE_MM / 2), rtol=1e-5)
    assert place_crops(plate(), places[1:], NYU)[0].shape == (0, SIZE, SIZE)


@given(seed=st.integers(0, 10**6))
def test_crops_of_places_are_those_of_each(seed: int) -> None:
    """Crops of several places equal crops cut one by one, in the same order, without places out of sight."""
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random((480, 640)) < 0.9, rng.uniform(400, 1500, (480, 640)), 0)
    places = rng.uniform((-900, -700, -100), (900, 700, 1500), (8, 3))
    crops, kept = [], []
    for place in places:
        try:
            if place[2] > MIN_DEPTH_MM:
                crops.append(crop(depth, NYU.project(place), CUBE_MM, NYU, SIZE))
                kept.append(place)
        except DataError:  # out of sight
            pass
    found, where = place_crops(depth, places, NYU)
    np.testing.assert_array_equal(found, np.reshape(crops, (-1, SIZE, SIZE)))
    np.testing.assert_array_equal(where, np.reshape(kept, (-1, 3)))


def test_the_middle_of_a_table_has_a_large_extent() -> None:
    """A surface continues in all directions in the middle of a table, in one from the hand at the end of an arm."""
    depth = np.full((480, 640), 900.0)
    depth[:, :40] = 0
    depth[200:260, 300:] = 700
    middle, hand, edge = NYU.unproject(np.array([[150.0, 100, 920], [330.0, 230, 720], [20.0, 300, 920]]))
    table, arm, empty = extent_around(depth, np.stack([middle, hand, edge]), NYU)
    assert table == 1 and 0 < arm < 0.3 and empty == 0
    assert extent_around(depth, np.zeros((0, 3)), NYU).shape == (0,)
