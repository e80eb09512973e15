r"""Residuals of points on capsules, and the normal equations of all of them.

A residual r measures one point of the body along one direction u. With c = (1 - s) E_i + s E_j the point at the place s
of a capsule's axis,

    dr / dx  =  (1 - s) u . dE_i/dx  +  s u . dE_j/dx  +  w d log radius / dx        z = ((1 - s) u, s u, w)

where w is what a radius adds as the body gets thicker. So each residual needs 8 numbers: z and r
itself. Their weighted products, added up for each capsule to an 8 x 8 matrix G_m, are all that the picture has to say:

    A  =  sum over capsules of  B_m^T G_m B_m        B_m = (dE_i/dx; dE_j/dx; 1 for size and girth), 7 x V
    b  =  sum over capsules of  B_m^T g_m            g_m the last column of G_m

There are some hundred residuals and 37 capsules: this is a third of the work of writing out their Jacobian. Every point
has two residuals, which share its capsule and place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.fitting.depth.body import GIRTH, SIZE, FleshModel, Posed

Floats = NDArray[np.float32]

_UPPER = np.triu_indices(8)  # an 8 x 8 matrix that is symmetric has 36 numbers ...
_FULL = np.zeros((8, 8), int)  # ... and each of its 64 is one of them
_FULL[_UPPER] = _FULL.T[_UPPER] = np.arange(36)


class Residuals(NamedTuple):
    """Two residuals of each of R points, in N frames, in mm."""

    capsule: NDArray[np.int_]  # (N, R)
    place: Floats  # (N, R) on its axis, 0 to 1
    direction: Floats  # (N, R, 2, 3): a residual grows by this much as the point moves
    swell: Floats  # (N, R, 2): ... and by this much as the logarithm of the radii grows
    value: Floats  # (N, R, 2)


def point_of(model: FleshModel, posed: Posed, capsule: NDArray[np.int_], place: Floats) -> tuple[Floats, Floats]:
    """The points (N, R, 3) at places on capsules' axes, and the radii (N, R) there."""
    n = np.arange(len(posed.ends))[:, None]
    a, b = posed.ends[n, model.start[capsule]], posed.ends[n, model.end[capsule]]
    ra, rb = model.radii[capsule, 0], model.radii[capsule, 1]
    radius = (ra + place * (rb - ra)) * posed.girth[:, None]
    return a + place[..., None] * (b - a), radius


def joined(first: Residuals, second: Residuals) -> Residuals:
    """All of both."""
    return Residuals(*(np.concatenate([a, b], axis=1) for a, b in zip(first, second)))


def normal_equations(model: FleshModel, posed: Posed, r: Residuals, weight: Floats) -> tuple[Floats, Floats]:
    """A (N, V, V) and b (N, V) of the squares weighted by (N, R, 2): half their gradient is b."""
    N, R, _ = r.value.shape
    M, V = len(model.start), model.variables
    # The points last: the innermost loops of all that follows are then long.
    root = np.sqrt(weight).transpose(0, 2, 1)
    z = np.empty((N, 8, 2, R), np.float32)
    np.multiply(r.direction.transpose(0, 3, 2, 1), root[:, None], out=z[:, :3])
    np.multiply(z[:, :3], r.place[:, None, None], out=z[:, 3:6])
    z[:, :3] -= z[:, 3:6]
    np.multiply(r.swell.transpose(0, 2, 1), root, out=z[:, 6])
    np.multiply(r.value.transpose(0, 2, 1), root, out=z[:, 7])
    products = z[:, _UPPER[0]]
    products *= z[:, _UPPER[1]]
    products = products[:, :, 0] + products[:, :, 1]  # (N, 36, R)
    belongs = (r.capsule[:, None] == np.arange(M)[:, None]).astype(np.float32)
    G = (belongs @ products.swapaxes(1, 2))[:, :, _FULL]  # (N, M, 8, 8)
    B = np.zeros((N, M, 7, V), np.float32)
    B[:, :, :3], B[:, :, 3:6] = posed.motion[:, model.start], posed.motion[:, model.end]
    B[:, :, 6, [SIZE, GIRTH]] = 1
    transposed = B.reshape(N, M * 7, V).swapaxes(1, 2)
    A = transposed @ (G[..., :7, :7] @ B).reshape(N, M * 7, V)
    b = transposed @ np.ascontiguousarray(G[..., :7, 7]).reshape(N, M * 7, 1)
    return A, b[..., 0]
