"""Bodies drawn from a prior: their poses, positions and sizes.

For their surfaces see ``surface_prior``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.model import Surface
from handpose.frames.cameras import Camera
from handpose.synthetic import prior_file
from handpose.synthetic.prior_names import Bent, Named
from handpose.synthetic.prior_parameters import (
    BendParameter,
    NormalParameter,
    PosePrior,
    TurnParameter,
)
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


class Bodies(NamedTuple):
    """N posed bodies, in half-cubes from their crop centres."""

    inputs: Array  # (N, D) parameters of the model
    bones: Array  # (N, K) bone lengths, including those of the surface alone
    joints: Array  # (N, K, 3)
    scale: Array  # (N,) size relative to the skeleton


class BodySampler:
    """Draws bodies and their crop centres.

    prior     by default that of the NYU hand
    cube_mm   edge of the crops; by default the prior's
    skeleton  with the limits of the poses and the bones to vary; by default the prior's

    rotation     the DoFs of the rotations
    translation  the DoFs along x, y, z of the joint that carries the crop centre; none
                 without a centre
    limbs        the other DoFs that are drawn, ascending
    """

    def __init__(
        self,
        prior: PosePrior | None = None,
        cube_mm: float | None = None,
        skeleton: Skeleton | None = None,
    ) -> None:
        self.prior = prior = prior or prior_file.load()
        self.cube_mm = cube_mm or prior.cube_mm
        self.skeleton = skeleton or prior.body()
        self.surface = Surface(self.skeleton)
        self._named = named = Named(prior, self.skeleton)
        self.rotation, self.translation = named.rotation, named.translation
        drawn = [*itertools.chain(*named.chains), *named.spread, *named.between]
        self.limbs = np.sort(np.concatenate([*drawn, np.zeros(0, int)]))
        self.poses = {name: self._inputs_of(parts) for name, parts in named.poses.items()}

    def draw(self, rng: np.random.Generator, count: int) -> Bodies:
        """Draw ``count`` bodies in poses without collisions of their parts."""
        skeleton, surface = self.skeleton, self.surface
        scale, bones = self._draw_sizes(rng, count)
        inputs = np.zeros((count, len(surface.whole.initial)))
        inputs[:, self.rotation] = self.rotations(rng, count) - skeleton.initial[self.rotation]

        def trial(todo: NDArray[np.int_], _: float) -> tuple[Array, Array]:
            trials = inputs[todo]
            self._draw_limbs(rng, trials)
            return trials, self._penetration_mm(trials, bones[todo], scale[todo])

        draw_again(inputs, self.prior.penetration, trial, range(self.prior.redraws))
        self._place(rng, inputs, bones, scale)
        joints = surface.kinematics.joints(inputs, bones)[:, : len(skeleton.joint_names)]
        return Bodies(inputs[:, : len(skeleton.initial)], bones, joints, scale)

    def rotations(self, rng: np.random.Generator, count: int) -> Array:
        """Draw the angles (count, T) of the turns in radians."""
        angles = [_angles(rng, turn, count) for turn in self.prior.turn]
        return np.deg2rad(np.stack(angles, axis=1) if angles else np.zeros((count, 0)))

    def centers(self, rng: np.random.Generator, count: int, camera: Camera) -> Array:
        """Crop centres (count, 3): px, px, mm; exact in float32, as the labels store them."""
        p = self.prior
        z = rng.uniform(p.depth.low, p.depth.high, count)
        x = _normal(rng, p.lateral_x, count) * z
        y = _normal(rng, p.lateral_y, count) * z
        uvd = camera.project(np.stack([x, y, z], axis=1))
        return uvd.astype(np.float32).astype(np.float64)

    @property
    def center(self) -> Array:
        """The centre of crops (3,) in the frame of its joint, in half-cubes."""
        c = self.prior.center
        return np.array([c.x, c.y, c.z] if c else [0.0, 0.0, 0.0]) / (self.prior.cube_mm / 2)

    def _draw_sizes(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """The scale (count,) of bodies, and their bones (count, K)."""
        p = self.prior
        bones = self.surface.whole.bones
        scale = cut_normal(rng, p.scale_mean, p.scale_std, (count,), p.scale_clip)
        factors = cut_normal(rng, 1, p.bone_std, (count, len(bones)), p.scale_clip)
        drawn = bones * scale[:, None] * factors
        for group, joints in zip(p.proportion, self._named.groups):
            drawn[:, joints] *= cut_normal(rng, 1, group.std, (count, 1), p.scale_clip)
        return scale, drawn

    def _penetration_mm(self, inputs: Array, bones: Array, scale: Array) -> Array:
        """The penetration (N,) of parts of bodies into each other."""
        surface = self.surface
        ends = surface.ends(surface.kinematics.forward(inputs, bones), scale)
        return surface.penetration(ends, surface.radii * scale[:, None, None]) * (self.cube_mm / 2)

    def _draw_limbs(self, rng: np.random.Generator, inputs: Array) -> None:
        """Set the limbs in ``inputs`` (N, D), within their limits."""
        N, lower, upper = len(inputs), self.skeleton.lower, self.skeleton.upper
        for bend, chains in zip(self.prior.bend, self._named.chains):
            self._bend(rng, inputs, bend, chains)
        for spread, d in zip(self.prior.spread, self._named.spread):
            values = spread.noise * rng.standard_normal((N, len(d))) * (upper - lower)[d]
            inputs[:, d] = np.clip(values, lower[d], upper[d])
        for between, d in zip(self.prior.between, self._named.between):
            part = rng.beta(between.a, between.b, (N, len(d)))
            inputs[:, d] = lower[d] + part * (upper - lower)[d]
        if self.prior.blend:
            self._blend(rng, inputs)

    def _bend(
        self,
        rng: np.random.Generator,
        inputs: Array,
        bend: BendParameter,
        chains: list[NDArray[np.int_]],
    ) -> None:
        """Set the DoFs of a ``bend``."""
        N = len(inputs)
        dofs = np.concatenate(chains)
        own = rng.beta(bend.own.a, bend.own.b, (N, len(chains)))
        shared = rng.beta(bend.shared.a, bend.shared.b, (N, 1))
        part = np.where(rng.random((N, 1)) < bend.independent, own, shared)
        each = np.repeat(part, [len(d) for d in chains], axis=1)
        noisy = each + bend.noise * rng.standard_normal(each.shape)
        inputs[:, dofs] = self._bent_by((bend.straight, dofs), np.clip(noisy, 0, 1))

    def _blend(self, rng: np.random.Generator, inputs: Array) -> None:
        """Set the limbs of some bodies between two named poses."""
        N, p, d = len(inputs), self.prior, self.limbs
        lower, upper = self.skeleton.lower[d], self.skeleton.upper[d]
        poses = np.stack(list(self.poses.values()))[:, d]
        chosen = rng.random(N) < p.blend
        first, second = rng.integers(len(poses), size=(2, N))
        part = rng.random((N, 1))
        between = (1 - part) * poses[first] + part * poses[second]
        between += p.blend_noise * rng.standard_normal(between.shape) * (upper - lower)
        inputs[np.ix_(chosen, d)] = np.clip(between, lower, upper)[chosen]

    def _place(self, rng: np.random.Generator, inputs: Array, bones: Array, scale: Array) -> None:
        """Move the bodies so that their crop centres, except for the jitter, are at the origin."""
        p, kinematics = self.prior, self.surface.kinematics
        if p.center is None:
            return
        is_wide = rng.random((len(inputs), 1)) < p.wide
        std_mm = np.where(is_wide, p.center_jitter_wide, p.center_jitter)
        jitter_mm = rng.standard_normal((len(inputs), 3)) * std_mm
        joint = self.skeleton.joint_names.index(p.center.joint)
        rotation = kinematics.rotation_of(kinematics.forward(inputs, bones), joint)
        in_joint_mm = (p.center.x, p.center.y, p.center.z)
        size = scale[:, None] * (self.cube_mm / p.cube_mm)
        center_mm = np.einsum("nij,j->ni", rotation, in_joint_mm) * size + jitter_mm
        center = center_mm / (self.cube_mm / 2)
        inputs[:, self.translation] = -center - self.skeleton.initial[self.translation]

    def _inputs_of(self, parts: list[tuple[Bent, float]]) -> Array:
        """The inputs (D,) of a named pose."""
        inputs = np.zeros(len(self.skeleton.initial))
        for bent, part in parts:
            inputs[bent[1]] = self._bent_by(bent, part)
        return inputs

    def _bent_by(self, bent: Bent, part: Array | float) -> Array:
        """The inputs (..., n) of DoFs bent by a fraction from 0 to 1."""
        straight, dofs = bent
        lower, upper = self.skeleton.lower[dofs], self.skeleton.upper[dofs]
        if straight == "UPPER":
            return upper - part * (upper - lower)
        return lower + part * (upper - lower)


def draw_again(
    best: Array,
    most: float,
    trial: Callable[[NDArray[np.int_], float], tuple[Array, Array]],
    factors: Iterable[float],
) -> None:
    """Fill rows (N, ...) with the first draws whose badness is at most ``most``; where there is
    none, with the least bad.

    trial    draws some rows with a factor; returns them and their badness
    factors  of the draws
    """
    todo = np.arange(len(best))
    least = np.full(len(best), np.inf)
    for factor in factors:
        drawn, badness = trial(todo, factor)
        is_better = badness < least[todo]
        better = todo[is_better]
        best[better] = drawn[is_better]
        least[better] = badness[is_better]
        todo = np.flatnonzero(least > most)
        if not len(todo):
            return


def _normal(rng: np.random.Generator, normal: NormalParameter | TurnParameter, count: int) -> Array:
    return normal.mean + normal.std * rng.standard_normal(count)


def _angles(rng: np.random.Generator, turn: TurnParameter, count: int) -> Array:
    """Angles (count,) of a turn in degrees."""
    if turn.any is None:
        angles = _normal(rng, turn, count)
    else:
        is_any = rng.random(count) < turn.any
        anywhere = rng.uniform(-180, 180, count)
        if turn.evenly:
            anywhere = np.rad2deg(np.arcsin(anywhere / 180))
        angles = np.where(is_any, anywhere, _normal(rng, turn, count))
    return np.clip(angles, -turn.most, turn.most)


def cut_normal(
    rng: np.random.Generator, mean: float, std: float, shape: tuple[int, ...], cut: float
) -> Array:
    """Normal numbers clipped at ``cut`` standard deviations from the mean."""
    return mean + std * np.clip(rng.standard_normal(shape), -cut, cut)
