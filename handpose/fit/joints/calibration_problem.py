"""The least-squares problem of a person's hand: bones and fixed angles of all frames, and the pose of each frame.

Bone lengths and fixed angles are *shared* by all frames of a person; the other angles belong to a frame. With theta_n
the free DoFs of frame n, and u the shared numbers as deviations from the template in units of their spread among
people (``BONE_SPREAD``, ``ANGLE_SPREAD``), the hand minimises

    sum_n |joints(theta_n, u) - seen_n|²  +  noise² ( w |u|²  +  sum_n |(theta_n - initial) / POSE_SPREAD|² )

With G_n and H_n the derivatives of frame n's joints by theta_n and by u, and r_n its residual, a step of
Levenberg-Marquardt solves

    [ A_1          B_1 ] [ dtheta_1 ]     [ a_1 ]       A_n = G_nᵀ G_n + ridge      a_n = G_nᵀ r_n + ridge
    [      ...     ... ] [   ...    ] = - [ ... ]       B_n = G_nᵀ H_n
    [ B_1ᵀ ...     C   ] [    du    ]     [  c  ]       C   = sum H_nᵀ H_n + ridge  c   = sum H_nᵀ r_n + ridge

with all diagonal elements times 1 + mu. Eliminating the poses (Schur complement) leaves 51 unknowns for the NYU hand:

    (C - sum B_nᵀ A_n⁻¹ B_n) du  =  -c + sum B_nᵀ A_n⁻¹ a_n              dtheta_n = -A_n⁻¹ (a_n + B_n du)

The derivative by a fixed angle is the Jacobian's column in a skeleton without fixed DoFs; that by a bone's length is
the direction of the bone, for its joint and all below it.

``noise`` is the standard deviation of a coordinate in the frames, estimated from the residual before every step, so
exact joints are reproduced exactly, and noisy ones are weighted accordingly. The ridge determines what the joints do
not. Frames are not independent: an annotator has systematic errors, and the errors of the poses, fitted to noisy
joints, are correlated with those of the bones. So w = N / INDEPENDENT_FRAMES. The remaining share of a bone's or fixed
angle's spread is

    noise sqrt(w diag((C - sum B_nᵀ A_n⁻¹ B_n)⁻¹))

and is 1 if the frames contain no information about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from handpose.fit.joints.angles import rotations
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.engine import for_each
from netlib.proto import schema
from netlib.system.memory import blocks

BONE_SPREAD = 0.1  # deviation of a bone among people of one size, relative to its length
ANGLE_SPREAD = 0.2  # ... of a fixed angle, radians
POSE_SPREAD = 0.5  # ... of a free angle among frames, radians; a root's DoFs have no such preference
INDEPENDENT_FRAMES = 30  # maximum effective number of frames
MIN_NOISE = 3e-3  # lower bound of the noise, relative to the mean bone (0.07 mm)
# Every fitted number leaves one residual fewer to estimate the noise from, but not where the ridge decides: with few
# joints none would be left. So at least a quarter count. From 8 joints (24 numbers for 26 DoFs) and noise of 1 and 3 mm
# the estimates are then 1.0 and 3.5 mm; with an eighth 1.6 and 7.2 mm, with a half 0.7 and 2.3 mm.
MIN_FREEDOM = 1 / 4
MIN_FRAMES = 20
CHUNK = 128  # frames that one thread works on together, in 40 MB


class State(NamedTuple):
    """The state of the search."""

    theta: Array  # (N, F) input + initial of the free DoFs
    shared: Array  # (S,) deviations from the template in units of their spread: fixed angles, then bones


class Normal(NamedTuple):
    """The normal equations, without ridge and damping."""

    A: Array  # (N, F, F)
    B: Array  # (N, F, S)
    C: Array  # (S, S)
    a: Array  # (N, F)
    c: Array  # (S,)


class CalibrationProblem:
    """The constants of the search, and the equations of a step.

    free    (F,) the DoFs that belong to a frame
    angles  the fixed rotations, first part of the S shared numbers
    bones   the joints with a bone, second part
    """

    def __init__(self, template: Skeleton, goal: Array, joints: Sequence[int]) -> None:
        self.template, self.goal, self.joints = template, goal, list(joints)
        # Without fixed DoFs the Jacobian has columns for all; with initial values 0 the input is theta.
        everything = [schema.changed(d, fixed=False, initial=0.0) for d in template.param.dof]
        opened = template.with_numbers(everything, template.bones)
        self.kinematics = kinematics_of(opened)
        driven, fixed = opened.driven, template.fixed[opened.driven]
        self.free = np.unique(driven[~fixed])
        self.angles = np.unique(driven[fixed & opened.turns])
        self.bones = np.flatnonzero(template.bone_axes >= 0)
        # Motions of one DoF are added: (Q, F + angles).
        self.sums = (driven[:, None] == np.concatenate([self.free, self.angles])).astype(float)
        self.beyond = template.descendants[self.bones][:, self.joints].astype(float)  # (bones, K)
        lengths = np.abs(template.bones[self.bones])
        self.spread = np.concatenate([np.full(len(self.angles), ANGLE_SPREAD), BONE_SPREAD * lengths])  # (S,)
        roots = np.flatnonzero(template.parents < 0)
        self.rooted = np.isin(self.free, [motion.dof for j in roots for motion in template.motions[j]])  # (F,)
        pulled = np.isin(self.free, rotations(template)) & ~self.rooted
        self.pose_ridge = np.where(pulled, POSE_SPREAD**-2.0, 0.0)  # (F,) times noise²
        self.shared_ridge = max(1.0, len(goal) / INDEPENDENT_FRAMES)  # times noise²
        self.known = np.asarray(~np.isnan(goal).any(axis=2))  # (N, K)
        numbers = 3 * np.count_nonzero(self.known)
        self.freedom = max(numbers - len(goal) * len(self.free) - len(self.spread), numbers * MIN_FREEDOM)
        self.least_noise = MIN_NOISE * float(lengths.mean())
        self.blocks = blocks(len(goal), CHUNK)

    def state(self, inputs: Array) -> State:
        """The template in the poses of its inputs (N, D)."""
        return State(self.template.theta(inputs)[:, self.free], np.zeros(len(self.spread)))

    def body(self, state: State, rows: slice) -> tuple[Array, Array]:
        """theta (n, D) of all DoFs in some frames, and their signed bones (n, all joints)."""
        n = len(state.theta[rows])
        theta, bones = np.tile(self.template.initial, (n, 1)), np.tile(self.template.bones, (n, 1))
        angles, lengths = np.split(state.shared * self.spread, [len(self.angles)])
        theta[:, self.free] = state.theta[rows]
        theta[:, self.angles] += angles
        bones[:, self.bones] += lengths
        return theta, bones

    def residual(self, positions: Array, rows: slice) -> Array:
        """(n, 3 K) of the positions (n, all joints, 3); 0 for joints that are not visible."""
        r = positions[:, self.joints] - self.goal[rows]
        return np.where(self.known[rows][:, :, None], r, 0.0).reshape(len(r), -1)

    def cost(self, state: State) -> tuple[float, float]:
        """The sum of squared residuals, and the ridge, which noise² multiplies."""
        found = np.zeros(len(self.blocks))

        def job(i: int) -> None:
            r = self.residual(self.kinematics.joints(*self.body(state, self.blocks[i])), self.blocks[i])
            found[i] = (r * r).sum()

        for_each(range(len(self.blocks)), job)
        ridge = (self.pose_ridge * self._bent(state) ** 2).sum() + self.shared_ridge * (state.shared**2).sum()
        return float(found.sum()), float(ridge)

    def noise(self, squares: float) -> float:
        """Deviation of a coordinate, from the sum of squared residuals."""
        return max(float(np.sqrt(squares / self.freedom)), self.least_noise)

    def _bent(self, state: State) -> Array:
        return state.theta - self.template.initial[self.free]

    def derivative(self, state: State, rows: slice) -> tuple[Array, Array]:
        """(n, F + S, 3 K): how the joints move with theta and the shared numbers; and the residual (n, 3 K)."""
        pose = self.kinematics.forward(*self.body(state, rows))
        n, turned = len(pose.joints), self.sums.shape[1]
        J = np.empty((n, turned + len(self.bones), 3 * len(self.joints)))
        np.matmul(self.sums.T, self.kinematics.jacobian(pose, self.joints), out=J[:, :turned])
        along = self.kinematics.bone_directions(pose)[:, self.bones]  # (n, bones, 3)
        J[:, turned:] = (self.beyond[:, :, None] * along[:, :, None]).reshape(n, len(self.bones), -1)
        J[:, len(self.free) :] *= self.spread[:, None]
        J *= np.repeat(self.known[rows], 3, axis=1)[:, None]
        return J, self.residual(pose.joints, rows)

    def normal(self, state: State) -> Normal:
        """The normal equations."""
        N, F, S = len(self.goal), len(self.free), len(self.spread)
        A, B, a = np.empty((N, F, F)), np.empty((N, F, S)), np.empty((N, F))
        C, c = np.empty((len(self.blocks), S, S)), np.empty((len(self.blocks), S))

        def job(i: int) -> None:
            rows = self.blocks[i]
            J, r = self.derivative(state, rows)
            M, m = J @ J.swapaxes(1, 2), (J @ r[:, :, None])[:, :, 0]
            A[rows], B[rows], a[rows] = M[:, :F, :F], M[:, :F, F:], m[:, :F]
            C[i], c[i] = M[:, F:, F:].sum(axis=0), m[:, F:].sum(axis=0)

        for_each(range(len(self.blocks)), job)
        return Normal(A, B, C.sum(axis=0), a, c.sum(axis=0))

    def reduced(self, normal: Normal, state: State, noise: float, mu: float) -> tuple[Array, Array, Array, Array]:
        """The equations without the poses, with ridge and damping: matrix (S, S), right side (S,); A⁻¹ B and A⁻¹ a."""
        N, F, S = normal.B.shape
        ridge = noise**2 * self.pose_ridge
        a = normal.a + ridge * self._bent(state)
        solved = np.empty((N, F, S + 1))
        parts = np.empty((len(self.blocks), S, S + 1))
        d = np.arange(F)
        # If no visible joint moves with an angle, its row of A is 0. A thousandth of the least relevant square makes A
        # invertible, and is negligible compared with the elements of an angle that moves a joint.
        floor = 1e-3 * self.least_noise**2

        def job(i: int) -> None:
            rows = self.blocks[i]
            A = normal.A[rows].copy()
            A[:, d, d] = (1 + mu) * (A[:, d, d] + ridge) + floor
            solved[rows] = np.linalg.solve(A, np.concatenate([normal.B[rows], a[rows, :, None]], axis=2))
            parts[i] = np.tensordot(normal.B[rows], solved[rows], axes=((0, 1), (0, 1)))

        for_each(range(len(self.blocks)), job)
        eliminated = parts.sum(axis=0)
        ridge_of_all = noise**2 * self.shared_ridge
        C = normal.C + np.diag(mu * np.diag(normal.C) + (1 + mu) * ridge_of_all)
        right = eliminated[:, S] - normal.c - ridge_of_all * state.shared
        return C - eliminated[:, :S], right, solved[:, :, :S], solved[:, :, S]

    def left(self, normal: Normal, state: State, noise: float) -> tuple[Array, Array]:
        """The remaining shares of the spread of fixed rotations (D,) and bones (all joints,); NaN for others."""
        matrix = self.reduced(normal, state, noise, mu=0.0)[0]
        left = noise * np.sqrt(self.shared_ridge * np.diag(np.linalg.inv(matrix)))
        of_angles, of_bones = np.full(len(self.template.initial), np.nan), np.full(len(self.template.parents), np.nan)
        of_angles[self.angles], of_bones[self.bones] = np.split(left, [len(self.angles)])
        return of_angles, of_bones
