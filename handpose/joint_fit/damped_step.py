"""The step of Levenberg-Marquardt within limits, for many frames at once."""

from __future__ import annotations

import numpy as np

from netlib.blob import Array


def damped_step(A: Array, b: Array, mu: Array, x: Array, lower: Array, upper: Array, ridge: float) -> Array:
    """The steps (N, F) that solve (A + mu diag(A) + ridge) step = -b; A is used up.

    A             (N, F, F) the normal matrix
    b             (N, F) half the gradient of the cost
    mu            (N,) damping
    x             (N, F) the variables, between lower and upper; one at a limit whose step would leave it gets 0
    lower, upper  (F,)
    ridge         keeps a variable that nothing depends on where it is
    """
    held = ((x <= lower) & (b > 0)) | ((x >= upper) & (b < 0))
    diagonal = np.arange(A.shape[1])
    A[:, diagonal, diagonal] *= 1 + mu[:, None]
    A[:, diagonal, diagonal] += ridge
    A[held[:, :, None] | held[:, None, :]] = 0
    A[:, diagonal, diagonal] += held
    return np.asarray(np.linalg.solve(A, np.where(held, 0, -b)[..., None])[..., 0])
