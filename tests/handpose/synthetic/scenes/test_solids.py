"""handpose/synthetic/scenes/solids.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.synthetic.scenes import solids
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.solids import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    Layer,
    Solids,
    joined,
    layer_of,
    nearest,
    plane_depth,
    solid_layer,
)

X = np.linspace(-0.2, 0.2, 9, dtype=np.float32)


@pytest.mark.parametrize("kind", [BOX, CYLINDER, ELLIPSOID])
def test_solids_agree_with_steps_along_the_rays(kind: int) -> None:
    """The first of many points on a ray that lies in the solid."""
    axes = Draw(np.random.default_rng(kind), 1).rotation()[0]
    center, half = np.array([20.0, -10.0, 500.0]), np.array([60.0, 40.0, 60.0])
    entry = solids._entry(kind, center, axes, half, X, X)
    steps = np.arange(350.0, 650.0, 0.25)
    u, v = np.meshgrid(X, -X)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1)
    points = steps[:, None] * rays[..., None, :]
    local = np.abs((points - center) @ axes / half)
    across, along, depth = np.moveaxis(local, -1, 0)
    size = {
        BOX: local.max(axis=-1),
        ELLIPSOID: np.linalg.norm(local, axis=-1),
        CYLINDER: np.maximum(along, np.hypot(across, depth)),
    }[kind]
    hit = (size <= 1).sum(axis=-1) > 8
    missed = size.min(axis=-1) > 1.01
    assert_allclose(entry[hit], steps[(size <= 1).argmax(axis=-1)][hit], atol=0.5)
    assert np.isinf(entry[missed]).all() and hit.sum() > 10


def balls(*z: float) -> Solids:
    """Balls of 30 mm in one frame, on the axis at these depths."""
    count = len(z)
    center = np.zeros((1, count, 3))
    center[..., 2] = z
    kind, shown = np.full((1, count), ELLIPSOID), np.ones((1, count), bool)
    axes, half = np.tile(np.eye(3), (1, count, 1, 1)), np.full((1, count, 3), 30.0)
    return Solids(kind, center, axes, half, shown)


def test_the_nearest_solid_is_shown_with_its_number() -> None:
    layer = solid_layer(balls(700, 500, 600), 7, (X[None], X[None]))
    assert layer.depth[0, 4, 4] == pytest.approx(470)
    assert layer.number[0, 4, 4] == 8
    assert np.isinf(layer.depth[0, 0, 0]) and layer.number[0, 0, 0] == 0


def test_hidden_and_too_near_solids_are_left_out() -> None:
    far = balls(500)._replace(shown=np.zeros((1, 1), bool))
    layer = solid_layer(joined([balls(80), far]), 1, (X[None], X[None]))
    assert np.isinf(layer.depth).all()


def test_the_nearest_layer_wins() -> None:
    back = layer_of(np.full((1, 2, 2), 900.0, np.float32), 3)
    front = np.full((1, 2, 2), np.inf)
    front[0, 0, 0] = 400.0
    both = nearest([back, Layer(front.astype(np.float32), np.full((1, 2, 2), 5, np.int16))])
    assert_array_equal(both.depth[0], [[400, 900], [900, 900]])
    assert_array_equal(both.number[0], [[5, 3], [3, 3]])


def test_planes_lie_at_their_offset() -> None:
    depth = plane_depth(np.array([[0.0, 0.6, 0.8]]), np.array([400.0]), (X[None], X[None]))
    along_the_normal = 0.8 - 0.6 * X[:, None]
    assert_allclose(depth[0] * along_the_normal, 400, rtol=1e-5)
