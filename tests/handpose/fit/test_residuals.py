"""handpose/fit/residuals.py"""

from __future__ import annotations

import numpy as np

from handpose.fit.body import CapsuleModel
from handpose.fit.residuals import Residuals, belonging, cones_of, joined, normal_equations
from tests.handpose.fit.conftest import slopes, written_out


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


def test_points_between_the_ends(model: CapsuleModel) -> None:
    """Places 0 and 1 are the capsule's ends with their radii, for all capsules or a selection."""
    posed = model.posed(np.full((2, model.variables), 0.1))
    cones = cones_of(model, posed)
    M = len(model.start)
    chosen = np.array([[3, 0, 3], [1, 2, M - 1]])
    for place, ends in ((0, model.start), (1, model.end)):
        c, radius = cones.at(np.full((2, M), place, np.float32))
        np.testing.assert_allclose(c, posed.ends[:, ends].swapaxes(1, 2), atol=1e-4)
        np.testing.assert_allclose(radius, model.radii[:, place] * posed.thickness[:, None], rtol=1e-5)
        some, own = cones.of(belonging(chosen, M)).at(np.full((2, 3), place, np.float32))
        np.testing.assert_array_equal(some, np.take_along_axis(c, chosen[:, None], axis=2))
        np.testing.assert_array_equal(own, np.take_along_axis(radius, chosen, axis=1))


def test_normal_equations_are_those_of_the_written_out_jacobian(model: CapsuleModel) -> None:
    """The equations equal A = sum w J Jt and b = sum w J r, with J computed row by row from the motion of the ends."""
    rng = np.random.default_rng(0)
    x = rng.normal(0, 0.2, (3, model.variables))
    posed, r = model.posed(x), some_residuals(model, rng, 3, 40)
    weight = rng.random((3, 2, 40)).astype(np.float32)
    A, b = normal_equations(model, posed, r, weight)
    J = written_out(model, posed, r)
    np.testing.assert_allclose(A, np.einsum("ntr,ntrv,ntrw->nvw", weight, J, J), rtol=1e-3, atol=1.0)
    np.testing.assert_allclose(b, np.einsum("ntr,ntrv,ntr->nv", weight, J, r.value), rtol=1e-3, atol=0.05)


def test_the_order_of_points_changes_nothing(model: CapsuleModel) -> None:
    """The sums are exact, so that the order of addition does not matter."""
    rng = np.random.default_rng(3)
    posed, r = model.posed(rng.normal(0, 0.2, (3, model.variables))), some_residuals(model, rng, 3, 400)
    weight = rng.random((3, 2, 400)).astype(np.float32)
    found = normal_equations(model, posed, r, weight)
    for order in (np.arange(400)[::-1], rng.permutation(400)):
        shuffled = Residuals(*(np.ascontiguousarray(values[..., order]) for values in r))
        for one, other in zip(found, normal_equations(model, posed, shuffled, weight[..., order])):
            np.testing.assert_array_equal(one, other)


def test_how_a_point_moves(model: CapsuleModel) -> None:
    """The motion of the ends, interpolated at the place, is the derivative of the point."""
    rng = np.random.default_rng(1)
    x, r = rng.normal(0, 0.2, (2, model.variables)), some_residuals(model, rng, 2, 20)
    belongs = belonging(r.capsule, len(model.start))
    moved = slopes(lambda x: cones_of(model, model.posed(x)).of(belongs).at(r.place)[0].swapaxes(1, 2), x)
    posed = model.posed(x)
    n, s = np.arange(2)[:, None], r.place[..., None, None]
    mixed = posed.motion[n, model.start[r.capsule]] * (1 - s) + posed.motion[n, model.end[r.capsule]] * s
    np.testing.assert_allclose(mixed, moved, atol=0.3)  # mm per radian, of differences in float32


def test_joined(model: CapsuleModel) -> None:
    """Residuals are concatenated along their last axis."""
    rng = np.random.default_rng(2)
    both = joined(some_residuals(model, rng, 2, 3), some_residuals(model, rng, 2, 4))
    assert both.capsule.shape == (2, 7) and both.direction.shape == (2, 3, 2, 7)
