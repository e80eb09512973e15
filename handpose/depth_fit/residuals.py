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

from handpose.depth_fit.body import GIRTH, SIZE, FleshModel, Posed
from netlib.blob import Array

Floats = NDArray[np.float32]

_UPPER = np.triu_indices(8)  # an 8 x 8 matrix that is symmetric has 36 numbers ...
_DIAGONAL = np.flatnonzero(_UPPER[0] == _UPPER[1])
_FULL = np.zeros((8, 8), int)  # ... and each of its 64 is one of them
_FULL[_UPPER] = _FULL.T[_UPPER] = np.arange(36)


class Residuals(NamedTuple):
    """Two residuals of each of R points, in N frames, in mm. Points come last: the innermost loops are then long."""

    capsule: NDArray[np.int_]  # (N, R)
    place: Floats  # (N, R) on its axis, 0 to 1
    direction: Floats  # (N, 3, 2, R): a residual grows by this much as the point moves
    swell: Floats  # (N, 2, R): ... and by this much as the logarithm of the radii grows
    value: Floats  # (N, 2, R)


class Cones(NamedTuple):
    """R capsules: all of a body, or for each point its own. In mm."""

    a: Floats  # (N, 3, R) where the axis starts
    along: Floats  # (N, 3, R) from there to its end
    radius: Floats  # (N, R) at its start
    wider: Floats  # (N, R): at the end the radius is larger by this

    def at(self, place: Floats) -> tuple[Floats, Floats]:
        """The points (N, 3, R) at places (N, R) on the axes, and the radii (N, R) there."""
        return self.a + place[:, None] * self.along, self.radius + place * self.wider

    def of(self, belongs: Floats) -> Cones:
        """Those of points, as ``belonging`` says: to pick by a product is faster than by indices."""
        picked = np.concatenate([self.a, self.along, self.radius[:, None], self.wider[:, None]], axis=1) @ belongs
        return Cones(picked[:, :3], picked[:, 3:6], picked[:, 6], picked[:, 7])


def cones_of(model: FleshModel, posed: Posed) -> Cones:
    """All M capsules."""
    ends = posed.ends.swapaxes(1, 2)
    a = ends[:, :, model.start]
    radii = model.radii.T * posed.girth[:, None, None]
    return Cones(a, ends[:, :, model.end] - a, radii[:, 0], radii[:, 1] - radii[:, 0])


def belonging(capsule: NDArray[np.int_], capsules: int) -> Floats:
    """(N, M, R): 1 where a point (N, R) is one of a capsule, else 0."""
    return np.equal(capsule[:, None], np.arange(capsules)[:, None]).astype(np.float32)


def joined(first: Residuals, second: Residuals) -> Residuals:
    """All of both."""
    return Residuals(*(np.concatenate([a, b], axis=-1) for a, b in zip(first, second)))


def normal_equations(model: FleshModel, posed: Posed, r: Residuals, weight: Floats) -> tuple[Array, Array]:
    """A (N, V, V) and b (N, V) of the squares weighted by (N, 2, R): half their gradient is b."""
    N, _, R = r.value.shape
    M, V = len(model.start), model.variables
    root = np.sqrt(weight)
    z = np.empty((N, 8, 2, R), np.float32)
    np.multiply(r.direction, root[:, None], out=z[:, :3])
    np.multiply(z[:, :3], r.place[:, None, None], out=z[:, 3:6])
    z[:, :3] -= z[:, 3:6]
    np.multiply(r.swell, root, out=z[:, 6])
    np.multiply(r.value, root, out=z[:, 7])
    products = z[:, _UPPER[0]]
    products *= z[:, _UPPER[1]]
    products = products[:, :, 0] + products[:, :, 1]  # (N, 36, R)
    _round_to_exact_sums(products)
    G = (belonging(r.capsule, M) @ products.swapaxes(1, 2))[:, :, _FULL].astype(np.float64)  # (N, M, 8, 8)
    B = np.zeros((N, M, 7, V))
    B[:, :, :3], B[:, :, 3:6] = posed.motion[:, model.start], posed.motion[:, model.end]
    B[:, :, 6, [SIZE, GIRTH]] = 1
    transposed = B.reshape(N, M * 7, V).swapaxes(1, 2)
    A = transposed @ (G[..., :7, :7] @ B).reshape(N, M * 7, V)
    b = transposed @ np.ascontiguousarray(G[..., :7, 7]).reshape(N, M * 7, 1)
    return A, b[..., 0]


def _round_to_exact_sums(products: Floats) -> None:
    """Round products (N, 36, R) of 8 numbers so that every sum along R is exact in float32, in any order.

    A processor's BLAS then changes nothing. With T a bound of the sum of absolute values, the products become multiples
    of some T / 2**22: adding and subtracting a number of the size of T rounds to them.
    """
    norms = np.sqrt(products[:, _DIAGONAL].sum(axis=2))  # by Cauchy and Schwarz, T is a product of two of them
    _, exponent = np.frexp(norms[:, _UPPER[0]] * norms[:, _UPPER[1]])
    large = np.ldexp(np.float32(1.5), exponent + 1)[:, :, None]
    products += large
    products -= large
