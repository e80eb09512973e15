"""The objective of a fit: the sum of its terms, each in units of its variance.

surface  points on the capsules, robust (Geman-McClure): k q / (k + q) for the squared distance q,
         with k the square of ``robust``. Errors of neighbouring points are correlated, so all of a
         frame count as ``independent`` points. Points on capsules that the skeleton does not have,
         a hand's forearm, count less, because sleeves and everything else that touches them would
         pull the body.
outline  spheres outside the silhouette, robust likewise
front    spheres in front of the surface, robust likewise
prior    limbs near the start's angles (covariance of the network's errors) and in natural poses
         (normal distribution), the palm near the network's, the surface's own variables near their
         means, size and thickness near the skeleton's
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from handpose.body.nyu import CUBE_MM
from handpose.fit.body import CapsuleModel, Posed
from handpose.fit.network_errors import Poses
from handpose.fit.observation import Observation
from handpose.fit.residuals import Residuals, normal_equations, residuals_of
from handpose.fit.settings import Weights
from handpose.frames.cameras import Floats
from netlib.blob import Array

MIN_SIZE_STD = 1e-4  # deviation of the logarithm of a size that is known


class Prior(NamedTuple):
    """The priors of N fits."""

    x: Array  # (N, V) expected variables
    rigid: Floats  # (N, n, 3) mm, expected ends that move with the root
    # (V, V) precision of the limbs, the surface's own variables, size and thickness
    curvature: Array


class Measured(NamedTuple):
    """The terms of N fits at some x, without the robust weights."""

    posed: Posed
    residuals: Residuals
    prior: Array  # (N,) cost of the prior
    prior_curvature: Array  # (N, V, V)
    prior_gradient: Array  # (N, V) half the gradient


class Cost(NamedTuple):
    """The costs of N fits at some x."""

    total: Array  # (N,)
    parts: Array  # (N, 4) surface, outline, front, prior
    weight: Floats  # (N, 2, R) weights of the squared residuals near this x


class Objective:
    """The terms of frames, as a function of x.

    poses  natural poses; None: all are alike
    """

    def __init__(self, model: CapsuleModel, weights: Weights, poses: Poses | None = None) -> None:
        self.model, self.weights, self.poses = model, weights, poses
        self.larger = max(1.0, 2 * model.unit_mm / CUBE_MM)
        # none on a forearm, whose end is not modelled
        self.spheres = np.flatnonzero(~model.surface.limbs)
        deviation = np.append(model.deviation, [max(weights.size, MIN_SIZE_STD), weights.thickness])
        self.plain = np.flatnonzero(np.isfinite(deviation))  # variables with a finite deviation
        self.plain_precision = deviation[self.plain] ** -2.0
        self.counts = np.where(model.surface.limbs, weights.beyond, 1.0).astype(np.float32)
        if poses is not None:
            self.natural = weights.poses * np.linalg.inv(poses.covariance)

    def of_known_size(self) -> Objective:
        """The same terms for bodies with the size of their start."""
        return Objective(self.model, replace(self.weights, size=0.0), self.poses)

    def prior_of(self, x: Array, precision: Array) -> Prior:
        """The prior of fits that start at x (N, V), with the precision (L, L) of the
        limbs' variables.
        """
        A = np.zeros((self.model.variables,) * 2)
        A[np.ix_(self.model.limbs, self.model.limbs)] = self.weights.limbs * precision
        A[self.plain, self.plain] = self.plain_precision
        return Prior(x, self.model.ends(x)[:, self.model.rigid], A)

    def measure(self, x: Array, seen: Observation, prior: Prior) -> Measured:
        """All terms at x (N, V) that do not depend on the robust distance."""
        posed = self.model.posed(x)
        residuals = residuals_of(
            self.model, posed, seen, self.spheres, self.weights.slack * self.larger
        )
        return Measured(posed, residuals, *self._prior(x, posed, prior))

    def weigh(self, m: Measured, seen: Observation, robust: float) -> Cost:
        """The cost with a robust distance in mm, for a hand's cube."""
        w = self.weights
        P = seen.points.shape[2]
        k = np.float32((robust * self.larger) ** 2)
        sigma = w.sigma * self.larger
        q = m.residuals.value * m.residuals.value
        of_points = q[:, :, :P]
        # a point's two residuals are robust together
        of_points[:] = of_points[:, :1] + of_points[:, 1:]
        weight = np.empty_like(q)
        unit = w.independent / sigma**2 / np.maximum(seen.known.sum(axis=1, keepdims=True), 1)
        counts = self.counts[m.residuals.capsule[:, :P]]
        weight[:, :, :P] = (seen.known * counts * unit.astype(np.float32))[:, None]
        of_spheres = np.array([w.outline, w.front], np.float32)
        weight[:, :, P:] = of_spheres[:, None] / np.float32(sigma**2)
        robustly = k / (k + q)
        weight *= robustly
        q *= weight
        weight *= robustly
        spheres = q[:, :, P:].sum(axis=2)
        surface = of_points[:, 0].sum(axis=1)
        columns = [surface, spheres[:, 0], spheres[:, 1], m.prior]
        parts = np.stack(columns, axis=1).astype(np.float64)
        return Cost(parts.sum(axis=1), parts, weight)

    def surface_cost(self, x: Array, seen: Observation, robust: float) -> Array:
        """The cost (N,) of the surface at x (N, V)."""
        posed, slack = self.model.posed(x), self.weights.slack * self.larger
        residuals = residuals_of(self.model, posed, seen, self.spheres, slack)
        none = np.zeros(len(x))
        return self.weigh(Measured(posed, residuals, none, none, none), seen, robust).parts[:, 0]

    def equations(self, m: Measured, cost: Cost) -> tuple[Array, Array]:
        """The Gauss-Newton curvature (N, V, V) and half the gradient (N, V) of the cost."""
        A, b = normal_equations(self.model, m.posed, m.residuals, cost.weight)
        return A + m.prior_curvature, b + m.prior_gradient

    def _prior(self, x: Array, posed: Posed, prior: Prior) -> tuple[Array, Array, Array]:
        """The prior's cost (N,), curvature (N, V, V) and half gradient (N, V)."""
        model = self.model
        rigid = np.float32(self.weights.rigid * self.larger)
        d = x - prior.x
        b = d @ prior.curvature
        cost = (b * d).sum(axis=1)
        if self.poses is not None:
            d = x[:, model.limbs] - self.poses.mean
            pull = d @ self.natural
            b[:, model.limbs] += pull
            cost += (pull * d).sum(axis=1)
        d = (posed.ends[:, model.rigid] - prior.rigid).reshape(len(x), -1) / rigid
        J = posed.motion[:, model.rigid].reshape(*d.shape, -1).astype(np.float64) / rigid
        A = J.swapaxes(1, 2) @ J + prior.curvature
        if self.poses is not None:
            rows, columns = np.ix_(model.limbs, model.limbs)
            A[:, rows, columns] += self.natural
        b += (J.swapaxes(1, 2) @ d[..., None])[..., 0]
        return cost + (d * d).sum(axis=1), A, b
