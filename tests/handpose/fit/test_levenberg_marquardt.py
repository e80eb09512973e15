"""damped_step: Newton's step without damping, a gradient step with much of it, and no step beyond a reached limit."""

import numpy as np
import pytest

from handpose.fit.levenberg_marquardt import damped_step

RNG = np.random.default_rng(0)
J, X = RNG.standard_normal((4, 9, 5)), RNG.standard_normal((4, 5))
A, B = J.swapaxes(1, 2) @ J, RNG.standard_normal((4, 5))
B[:, 2] = 1, -1, 1, -1
WIDE = np.full(5, -100.0), np.full(5, 100.0)


def step(mu: float, x: np.ndarray = X, limits: tuple[np.ndarray, np.ndarray] = WIDE, ridge: float = 0) -> np.ndarray:
    return damped_step(A.copy(), B, np.full(4, mu), x, *limits, ridge)


def test_without_damping() -> None:
    """Without damping the step leads to the minimum of the quadratic model."""
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, step(0)), -B, atol=1e-10)


def test_much_damping() -> None:
    """Much damping gives a short step downhill, with each variable scaled by its own curvature."""
    np.testing.assert_allclose(step(1e9) * 1e9, -B / A[:, range(5), range(5)], rtol=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_at_a_limit(side: int) -> None:
    """A variable at a limit that would leave it stays, and the others take the step of the problem without it."""
    limits = np.full(5, -100.0), np.full(5, 100.0)
    limits[side][2] = 0.3
    x = X.copy()
    x[:, 2] = 0.3
    leaves = B[:, 2] > 0 if side == 0 else B[:, 2] < 0
    found, others = step(0, x, limits), [0, 1, 3, 4]
    np.testing.assert_array_equal(found[leaves, 2], 0)
    np.testing.assert_allclose(found[~leaves], step(0)[~leaves], atol=1e-12)
    for n in np.flatnonzero(leaves):
        np.testing.assert_allclose(A[n][np.ix_(others, others)] @ found[n, others], -B[n, others], atol=1e-10)


def test_nothing_depends_on_a_variable() -> None:
    """A variable without influence stays, because the ridge makes the matrix invertible."""
    still, gradient = A.copy(), B.copy()
    still[:, 1] = still[:, :, 1] = gradient[:, 1] = 0
    np.testing.assert_array_equal(damped_step(still, gradient, np.zeros(4), X, *WIDE, 1e-9)[:, 1], 0)
