"""handpose/fit/residuals.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import CapsuleModel
from handpose.fit.observation import HandCrops, Observation, observe
from handpose.fit.residuals import (
    Cones,
    Residuals,
    cones_of,
    nearest_capsules,
    normal_equations,
    point_residuals,
    sphere_residuals,
)
from handpose.frames.cameras import NYU
from tests.handpose.fit.conftest import Scene, slopes, written_out
from tests.handpose.fit.test_body import body

PIPE = """name: "pipe" dof { name: "x" } dof { name: "turn" }
joint { name: "a" translate { axis: X dof: "x" } rotate { axis: Z dof: "turn" } }
joint { name: "b" parent: "a" bone { axis: X length: 10 } }
flesh { capsule { from: "a" to: "b" radius: %g radius: %g } }
"""


def pipe(ra: float = 1, rb: float = 1) -> CapsuleModel:
    """A capsule along x, 100 mm long; radii in cm."""
    return body(PIPE % (ra, rb))


def cones_at(model: CapsuleModel, x: np.ndarray) -> Cones:
    """All capsules at variables x."""
    return cones_of(model, model.posed(x))


def spheres_of(model: CapsuleModel) -> np.ndarray:
    """The capsules of the skeleton's own joints."""
    return np.flatnonzero(~model.surface.limbs)


def looking(points: np.ndarray) -> Observation:
    """Points (P, 3) seen by a distant camera along z."""
    P = len(points)
    rays = np.tile(np.array([[0], [0], [1]], np.float32), (1, 1, P))
    zero = np.zeros((1, 128, 128), np.float32)
    one = np.ones(1, np.float32)
    seen, weight = points.T[None].astype(np.float32), np.ones((1, P), np.float32)
    center = np.zeros((1, 3), np.float32)
    scale = one[:, None]
    return Observation(seen, rays, weight, np.zeros(1, int), zero, zero, center, one, scale, scale)


@pytest.mark.parametrize(
    ("point", "place", "values"),
    [
        ((50, 0, -10), 0.5, (0, 0)),  # on the facing side
        ((50, 0, -13), 0.5, (3, 0)),  # in front of it
        ((50, 0, -6), 0.5, (-4, 0)),  # inside
        ((-7, 0, 0), 0.0, (-3, 0)),  # at the round end
        ((50, 10, 0), 0.5, (0, 0)),  # on the outline
        ((50, 4, 8), 0.5, (-6, 8)),  # behind: to the outline, sideways and along the ray
        ((50, 0, 10), 0.5, (-10, 10)),  # on the far side, which the camera cannot see
    ],
)
def test_residuals_of_a_pipe(
    point: tuple[float, ...], place: float, values: tuple[float, ...]
) -> None:
    """The residuals equal values worked out by hand."""
    model = pipe()
    cones, only = cones_at(model, np.zeros((1, 4))), np.zeros((1, 1), int)
    found = point_residuals(cones, looking(np.array([point])), only)
    assert found.place[0, 0] == pytest.approx(place)
    assert found.value[0, :, 0] == pytest.approx(values, abs=1e-3)


def test_the_surface_of_a_cone() -> None:
    """For different radii, points on the tangent cone have residual 0, at any place along it."""
    model = pipe(2, 1)
    a, b, ra, rb = (0.0, 100.0, 20.0, 10.0)
    tilt = np.arcsin((ra - rb) / (b - a))
    s = np.linspace(0.05, 0.9, 9)
    r = ra + s * (rb - ra)
    points = np.stack([s * b + r * np.sin(tilt), 0 * s, -r * np.cos(tilt)], axis=1)
    cones, only = cones_at(model, np.zeros((1, 4))), np.zeros((1, 9), int)
    found = point_residuals(cones, looking(points), only)
    assert_allclose(found.value, 0, atol=1e-3)
    assert_allclose(found.place[0], s, atol=1e-4)


def test_derivatives_of_point_residuals_agree_with_differences(
    model: CapsuleModel, scene: Scene, rng: np.random.Generator
) -> None:
    """With fixed capsules, direction and swelling are the residuals' derivatives by each variable.

    This holds for the facing side only: the place of points behind it slides along the outline,
    to second order.
    """
    x = scene.truth + rng.normal(0, 0.03, scene.truth.shape)
    capsule = nearest_capsules(cones_at(model, x), scene.seen)

    def values(x: np.ndarray) -> np.ndarray:
        return point_residuals(cones_at(model, x), scene.seen, capsule).value.astype(float)

    r = point_residuals(cones_at(model, x), scene.seen, capsule)
    slope = slopes(values, x, 2e-3)
    off = np.abs(slope - written_out(model, model.posed(x), r))[:, 0]  # mm per radian
    off[(r.value[:, 1, :, None] != 0) | (slope[:, 1] != 0)] = np.nan
    assert np.isfinite(off).mean(axis=(0, 1)).min() > 0.7
    assert np.nanpercentile(off, 95, axis=(0, 1)).max() < 2


def test_the_nearest_of_all_capsules(model: CapsuleModel, scene: Scene) -> None:
    """No other capsule is nearer by more than the effect of different radii."""
    cones = cones_at(model, scene.truth)
    chosen = nearest_capsules(cones, scene.seen)

    def distance(capsule: np.ndarray) -> np.ndarray:
        return np.linalg.norm(point_residuals(cones, scene.seen, capsule).value, axis=1)

    every = np.stack([distance(np.full(chosen.shape, m)) for m in range(len(model.start))])
    assert (distance(chosen) - every.min(axis=0)).max() < 2


def test_derivatives_of_sphere_residuals_agree_with_differences(
    model: CapsuleModel, scene: Scene
) -> None:
    """The interpolated outline has an exact slope: active residuals change as direction and
    swelling predict.
    """
    x = scene.truth.copy()
    x[:, 0] += 0.1

    def outside(x: np.ndarray) -> np.ndarray:
        value = sphere_residuals(cones_at(model, x), scene.seen, spheres_of(model), 3.0).value[:, 0]
        return np.where(value > 0, value, np.nan)

    r = sphere_residuals(cones_at(model, x), scene.seen, spheres_of(model), 3.0)
    slope = np.where(r.value[:, 0, :, None] > 0, slopes(outside, x), np.nan)
    # mm per radian, except at borders of pixels
    off = np.abs(slope - written_out(model, model.posed(x), r)[:, 0])
    assert np.isfinite(off).sum(axis=(0, 1)).min() > 25
    assert np.nanpercentile(off, 80, axis=(0, 1)).max() < 4


def test_spheres_before_a_plate(model: CapsuleModel) -> None:
    """The residuals, worked out by hand, of spheres at the ends of capsules before a plate 30 mm
    behind the centre.
    """
    seen = observe(
        HandCrops(np.full((1, 128, 128), 0.2, np.float32), [[320, 240, 700]], NYU, 300.0), 400, 3.0
    )
    posed, spheres = model.posed(np.zeros((1, model.variables))), spheres_of(model)
    found = sphere_residuals(cones_of(model, posed), seen, spheres, 3.0)
    x, y, z = posed.ends[0, model.end[spheres]].T
    expected = np.maximum(30 - (z - model.radii[spheres, 1]) - 3, 0)
    shown = (np.abs([x, y]) < 120).all(axis=0)
    assert expected[shown].max() > 10
    assert_allclose(found.value[0, 1, shown], expected[shown], atol=1e-3)
    assert_array_equal(found.capsule, spheres[None])
    # the plate fills the picture
    assert (found.value[:, 0] == 0).all() and (found.place == 1).all()


def some_residuals(model: CapsuleModel, rng: np.random.Generator, N: int, R: int) -> Residuals:
    """Residuals of random capsules, places and directions."""
    f4 = np.float32
    return Residuals(
        capsule=rng.integers(0, len(model.start), (N, R)),
        place=rng.random((N, R), f4),
        direction=rng.normal(size=(N, 3, 2, R)).astype(f4),
        swell=rng.normal(size=(N, 2, R)).astype(f4),
        value=rng.normal(size=(N, 2, R)).astype(f4),
    )


def test_normal_equations_are_those_of_the_written_out_jacobian(
    model: CapsuleModel, rng: np.random.Generator
) -> None:
    """The equations equal A = sum w J Jt and b = sum w J r, with J computed row by row from the
    motion of the ends.
    """
    x = rng.normal(0, 0.2, (3, model.variables))
    posed, r = model.posed(x), some_residuals(model, rng, 3, 40)
    weight = rng.random((3, 2, 40)).astype(np.float32)
    A, b = normal_equations(model, posed, r, weight)
    J = written_out(model, posed, r)
    weighted = weight[..., None] * J
    expected = np.einsum("ntrv,ntrw->nvw", weighted, J)
    assert_allclose(A, expected, rtol=1e-3, atol=1.0)
    expected = np.einsum("ntrv,ntr->nv", weighted, r.value)
    assert_allclose(b, expected, rtol=1e-3, atol=0.05)


def test_the_order_of_points_changes_nothing(model: CapsuleModel) -> None:
    """The sums are exact, so that the order of addition does not matter."""
    rng = np.random.default_rng(3)
    posed = model.posed(rng.normal(0, 0.2, (3, model.variables)))
    r = some_residuals(model, rng, 3, 400)
    weight = rng.random((3, 2, 400)).astype(np.float32)
    found = normal_equations(model, posed, r, weight)
    for order in (np.arange(400)[::-1], rng.permutation(400)):
        shuffled = Residuals(*(np.ascontiguousarray(values[..., order]) for values in r))
        for one, other in zip(found, normal_equations(model, posed, shuffled, weight[..., order])):
            assert_array_equal(one, other)
