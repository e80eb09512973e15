"""Starts of fits: the error of a pose has many local minima, and each start leads to one.

near the goal   the rotation of the whole body, from a grid, that brings the joints closest after aligning centroids;
                the limbs are given (one product of all frames with all rotations finds it)
redrawn limbs   the best pose so far with about half of its limbs drawn again
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from handpose.joint_fit.pose_problem import PoseProblem
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

GRID_STEP = np.pi / 6  # angle between the rotations of the grid


class RotationGrid:
    """First guesses with one pose of the limbs, inputs (D,), in all rotations of the body."""

    def __init__(self, problem: PoseProblem, limbs: Array) -> None:
        self.problem, sk = problem, problem.skeleton
        grid = np.arange(-np.pi, np.pi - 1e-9, GRID_STEP)
        tried = problem.root_turns[:3]  # the grid of more rotations would be too large; the descent finds them
        angles = np.zeros((len(grid) ** len(tried), len(problem.root_turns)))
        angles[:, : len(tried)] = list(itertools.product(grid, repeat=len(tried)))
        if len(problem.root_turns) == 3:  # the second angle needs half a turn only: see angles.py
            angles = angles[np.abs(angles[:, 1]) <= np.pi / 2 + 1e-9]
        self.inputs = np.tile(limbs, (len(angles), 1))
        self.inputs[:, problem.root_turns] = angles - sk.initial[problem.root_turns]
        joints = problem.kinematics.forward(self.inputs).joints[:, problem.joints]
        self.centroids = joints.mean(axis=1)
        self.shapes = (joints - self.centroids[:, None]).reshape(len(angles), -1)
        self.sizes = (self.shapes**2).sum(axis=1)

    def near(self, goal: Array) -> Array:
        """The best inputs (N, D) of the grid for joints (N, K, 3)."""
        problem, centre = self.problem, np.nanmean(goal, axis=1)
        shapes = np.nan_to_num(goal - centre[:, None]).reshape(len(goal), -1)  # unknown joints: in the middle
        best = np.argmin(self.sizes - 2 * shapes @ self.shapes.T, axis=1)
        inputs = self.inputs[best]
        for motion in problem.root_moves:
            inputs[:, motion.dof] += motion.sign * (centre - self.centroids[best])[:, motion.axis]
        inputs[:, problem.free] = np.clip(inputs[:, problem.free], problem.lower, problem.upper)
        return np.asarray(inputs)


def limb_poses(problem: PoseProblem, count: int, seed: int) -> Array:
    """Inputs (count, D): the initial pose, then random ones within the limits."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((count, len(problem.skeleton.initial)))
    poses[1:, problem.limb_turns] = _drawn(problem.skeleton, problem.limb_turns, count - 1, rng)
    return poses


def redrawn_limbs(skeleton: Skeleton, inputs: Array, rng: np.random.Generator) -> Array:
    """The inputs (N, D) with new angles, within the limits, for about half of the limbs."""
    result = inputs.copy()
    for limb in limbs(skeleton):
        drawn = rng.random(len(inputs)) < 0.5
        result[np.ix_(drawn, limb)] = _drawn(skeleton, limb, int(np.count_nonzero(drawn)), rng)
    return result


def limbs(skeleton: Skeleton) -> list[NDArray[np.int_]]:
    """The free rotations of each limb, the subtree of one child of a root."""
    children = np.flatnonzero(np.isin(skeleton.parents, np.flatnonzero(skeleton.parents < 0)))
    found = []
    for joints in sorted(np.flatnonzero(skeleton.carries[child]).tolist() for child in children):
        own = {m.dof for joint in joints for m in skeleton.motions[joint] if m.kind == "rotate" and m.row >= 0}
        found.append(np.array(sorted(own), dtype=int))
    return [own for own in found if len(own)]


def _drawn(skeleton: Skeleton, dofs: NDArray[np.int_], count: int, rng: np.random.Generator) -> Array:
    """Angles (count, len(dofs)) within the limits, and within half a turn of the initial pose."""
    low, high = np.maximum(skeleton.lower[dofs], -np.pi), np.minimum(skeleton.upper[dofs], np.pi)
    return rng.uniform(low, high, (count, len(dofs)))
