"""handpose/fitting/depth/residuals.py"""

from __future__ import annotations

import numpy as np

from handpose.fitting.depth.body import GIRTH, SIZE, FleshModel
from handpose.fitting.depth.residuals import Residuals, joined, normal_equations, point_of
from tests.handpose.fitting.depth.conftest import slopes


def some_residuals(model: FleshModel, rng: np.random.Generator, N: int, R: int) -> Residuals:
    """Of any capsules, places and directions."""
    f4 = np.float32
    return Residuals(
        capsule=rng.integers(0, len(model.start), (N, R)),
        place=rng.random((N, R), f4),
        direction=rng.normal(size=(N, R, 2, 3)).astype(f4),
        swell=rng.normal(size=(N, R, 2)).astype(f4),
        value=rng.normal(size=(N, R, 2)).astype(f4),
    )


def test_points_between_the_ends(model: FleshModel) -> None:
    """At 0 and 1 they are the ends with their radii, between them in a straight line."""
    posed = model.posed(np.full((2, model.variables), 0.1))
    capsule = np.tile(np.arange(len(model.start)), (2, 1))
    for place, ends in ((0, model.start), (1, model.end)):
        c, radius = point_of(model, posed, capsule, np.full(capsule.shape, place, np.float32))
        np.testing.assert_allclose(c, posed.ends[:, ends], atol=1e-4)
        np.testing.assert_allclose(radius, model.radii[:, place] * posed.girth[:, None], rtol=1e-5)


def test_normal_equations_are_those_of_the_written_out_jacobian(model: FleshModel) -> None:
    """A = sum w J Jt and b = sum w J r, with J row by row from how the ends move."""
    rng = np.random.default_rng(0)
    x = rng.normal(0, 0.2, (3, model.variables))
    posed, r = model.posed(x), some_residuals(model, rng, 3, 40)
    weight = rng.random((3, 40, 2)).astype(np.float32)
    A, b = normal_equations(model, posed, r, weight)
    for n in range(3):
        start, end = (posed.motion[n, ends[r.capsule[n]]].astype(float) for ends in (model.start, model.end))
        moved = start * (1 - r.place[n])[:, None, None] + end * r.place[n][:, None, None]  # (R, 3, V)
        J = np.einsum("rti,riv->rtv", r.direction[n], moved)
        J[..., SIZE] += r.swell[n]
        J[..., GIRTH] += r.swell[n]
        np.testing.assert_allclose(A[n], np.einsum("rt,rtv,rtw->vw", weight[n], J, J), rtol=1e-3, atol=1.0)
        np.testing.assert_allclose(b[n], np.einsum("rt,rtv,rt->v", weight[n], J, r.value[n]), rtol=1e-3, atol=0.05)


def test_how_a_point_moves(model: FleshModel) -> None:
    """The motion of the ends, mixed as the place says, is the derivative of the point."""
    rng = np.random.default_rng(1)
    x, r = rng.normal(0, 0.2, (2, model.variables)), some_residuals(model, rng, 2, 20)
    moved = slopes(lambda x: point_of(model, model.posed(x), r.capsule, r.place)[0], x)
    posed = model.posed(x)
    n, s = np.arange(2)[:, None], r.place[..., None, None]
    mixed = posed.motion[n, model.start[r.capsule]] * (1 - s) + posed.motion[n, model.end[r.capsule]] * s
    np.testing.assert_allclose(mixed, moved, atol=0.3)  # mm per radian, of differences in float32


def test_joined(model: FleshModel) -> None:
    """One after the other."""
    rng = np.random.default_rng(2)
    both = joined(some_residuals(model, rng, 2, 3), some_residuals(model, rng, 2, 4))
    assert both.capsule.shape == (2, 7) and both.direction.shape == (2, 7, 2, 3)
