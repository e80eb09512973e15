r"""Residuals of points on capsules, and the normal equations of all of them.

A residual r measures one point of the body along one direction u. With c = (1 - s) E_i + s E_j the point at the place s
of a capsule's axis,

    dr / dx  =  (1 - s) u . dE_i/dx  +  s u . dE_j/dx  +  w d log radius / dx        z = ((1 - s) u, s u, w)

where w is the contribution of the radius as the body gets thicker. So each residual needs 8 numbers: z and r
itself. Their weighted products, summed for each capsule to an 8 x 8 matrix G_m, determine the normal equations:

    A  =  sum over capsules of  B_m^T G_m B_m        B_m = (dE_i/dx; dE_j/dx; 1 for size and thickness), 7 x V
    b  =  sum over capsules of  B_m^T g_m            g_m the last column of G_m

There are several hundred residuals and 37 capsules: this takes a third of the time of the full Jacobian. Every point
has two residuals, which share its capsule and place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import SIZE, THICKNESS, CapsuleModel, Posed
from netlib.blob import Array

Floats = NDArray[np.float32]

_UPPER = np.triu_indices(8)  # the 36 independent elements of a symmetric 8 x 8 matrix
_DIAGONAL = np.flatnonzero(_UPPER[0] == _UPPER[1])
_FULL = np.zeros((8, 8), int)  # for each of the 64 elements, its index among the 36
_FULL[_UPPER] = _FULL.T[_UPPER] = np.arange(36)


class Residuals(NamedTuple):
    """Two residuals for each of R points in N frames, in mm. Points come last, so the innermost loops are long."""

    capsule: NDArray[np.int_]  # (N, R)
    place: Floats  # (N, R) position on the capsule's axis, 0 to 1
    direction: Floats  # (N, 3, 2, R): derivatives of the residuals by the point's position
    swell: Floats  # (N, 2, R): derivatives by the logarithm of the radii
    value: Floats  # (N, 2, R)


class Cones(NamedTuple):
    """R capsules: all of a body, or one for each point. In mm."""

    a: Floats  # (N, 3, R) start of the axis
    along: Floats  # (N, 3, R) end minus start
    radius: Floats  # (N, R) at its start
    wider: Floats  # (N, R) radius at the end minus radius at the start

    def at(self, place: Floats) -> tuple[Floats, Floats]:
        """The points (N, 3, R) at positions (N, R) on the axes, and the radii (N, R) there."""
        return self.a + place[:, None] * self.along, self.radius + place * self.wider

    def of(self, belongs: Floats) -> Cones:
        """The capsules of the points given by ``belonging``; a product is faster than indexing."""
        picked = np.concatenate([self.a, self.along, self.radius[:, None], self.wider[:, None]], axis=1) @ belongs
        return Cones(picked[:, :3], picked[:, 3:6], picked[:, 6], picked[:, 7])


def cones_of(model: CapsuleModel, posed: Posed) -> Cones:
    """All M capsules."""
    ends = posed.ends.swapaxes(1, 2)
    a = ends[:, :, model.start]
    radii = model.radii.T * posed.thickness[:, None, None]
    return Cones(a, ends[:, :, model.end] - a, radii[:, 0], radii[:, 1] - radii[:, 0])


def belonging(capsule: NDArray[np.int_], capsules: int) -> Floats:
    """(N, M, R): 1 where a point (N, R) is one of a capsule, else 0."""
    return np.equal(capsule[:, None], np.arange(capsules)[:, None]).astype(np.float32)


def joined(first: Residuals, second: Residuals) -> Residuals:
    """Both sets of residuals."""
    return Residuals(*(np.concatenate([a, b], axis=-1) for a, b in zip(first, second)))


def normal_equations(model: CapsuleModel, posed: Posed, r: Residuals, weight: Floats) -> tuple[Array, Array]:
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
    B[:, :, 6, [SIZE, THICKNESS]] = 1
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
