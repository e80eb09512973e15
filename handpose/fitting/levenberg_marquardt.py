r"""Fit a skeleton to given joints: which inputs theta put the model's joints where they were seen?

Two ways:

``fit``    Levenberg-Marquardt for many frames at once. With r the differences of all chosen joints and J their
           derivative (``Skeleton.jacobian``), each iteration solves for every frame

               (A + mu diag(A)) step  =  -(Jᵀ r + ridge theta)        A = Jᵀ J + ridge

           takes the step if it lowers |r|² + ridge |theta|², and then trusts more (mu / 3), else less (4 mu).
           With limits, steps are cut at them, and an angle that stands at a limit and wants beyond it is held.
``swarm``  particle swarm optimisation, as the paper did it: no derivative, a thousand times the work, a worse result.
           Kept for comparison.

The error of a hand has many valleys, so ``fit`` starts several times: first from the initial pose of the fingers in
that rotation of the whole body, of a grid, which puts the joints nearest after moving the centroids together (one
product of all frames with all rotations finds it); then in turn from the best so far with about half of the limbs
drawn anew, and as at first but with drawn fingers.

Everything is in the unit of the skeleton's bones: half-cubes for the NYU hand.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.angles import canonical, rotations
from layers.kinematics import Skeleton
from netlib import parallel
from netlib.errors import DataError

Array = NDArray[np.float64]
Progress = Callable[[int], None]

CHUNK = 256  # frames worked on together by a thread
GRID_STEP = np.pi / 6  # between rotations of the whole body that are tried at the start
SMALLEST_GAIN = 1e-7  # relative; a frame whose cost falls less is done
EXACT = 5e-6  # root mean square distance of the joints at which a frame needs no other start
LARGEST_MU = 1e8


@dataclass(frozen=True)
class Fit:
    """The best pose of every frame.

    inputs     (N, D) canonical inputs of the model, within its limits if they were kept; radians and units of the
               bones; fixed DoFs 0
    residuals  (N, K) distance of each chosen joint from where it should be, in the same unit; NaN where not known
    """

    inputs: Array
    residuals: Array


def fit(
    skeleton: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    limits: bool = True,
    ridge: float = 0.0,
    starts: int = 8,
    iterations: int = 100,
    seed: int = 0,
    progress: Progress = lambda done: None,
) -> Fit:
    """Fit every frame by itself. Results do not depend on the number of threads. Raises DataError.

    targets     (N, K, 3) where the joints should be; NaN for a joint that is not known in a frame
    joints      the K joints of the skeleton that they are; by default all
    limits      keep the inputs within the skeleton's limits
    ridge       weight of the squared inputs (rotations of limbs) beside the squared distances: pulls angles that the
                joints hardly determine towards the initial pose
    starts      how often to start; a frame that fits exactly is not started again
    iterations  at most so many a start
    progress    is told how many frames more are done, by any thread
    """
    goal, chosen = _checked(skeleton, targets, joints)
    if starts < 1 or iterations < 1 or not ridge >= 0:
        raise DataError(
            f"{starts} starts of {iterations} iterations with ridge {ridge:g}, expected 1 or more, ridge 0 or more"
        )
    problem = _Problem(skeleton, chosen, limits, ridge)
    guesses = [_Guess(problem, fingers) for fingers in problem.finger_poses(1 + (starts - 1) // 2, seed)]
    inputs = np.zeros((len(goal), len(skeleton.initial)))

    def job(rows: slice) -> None:
        rng = np.random.default_rng([seed, rows.start])
        inputs[rows] = _best(problem, guesses, goal[rows], starts, iterations, rng)
        progress(rows.stop - rows.start)

    parallel.run([partial(job, rows) for rows in parallel.blocks(len(goal), CHUNK)])
    return _result(problem, inputs, goal, limits)


def _result(problem: _Problem, inputs: Array, goal: Array, limits: bool) -> Fit:
    """Inputs (N, D) in canonical form, and what they leave of the goal (N, K, 3)."""
    final = canonical(problem.skeleton, inputs, limits=limits)
    final[:, problem.free] = np.clip(final[:, problem.free], problem.lower, problem.upper)  # takes rounding back
    found = problem.skeleton.forward(final).joints[problem.joints].transpose(2, 0, 1)
    return Fit(final, np.linalg.norm(found - goal, axis=2))


def _checked(skeleton: Skeleton, targets: ArrayLike, joints: Sequence[int] | None) -> tuple[Array, list[int]]:
    goal = np.asarray(targets, dtype=np.float64)
    chosen = list(range(len(skeleton.parents))) if joints is None else list(joints)
    if goal.ndim != 3 or goal.shape[1:] != (len(chosen), 3):
        raise DataError(f"joints of shape {goal.shape}, expected (N, {len(chosen)}, 3)")
    if np.isinf(goal).any():
        raise DataError(f"frame {int(np.isinf(goal).any(axis=(1, 2)).argmax())} has an infinite joint")
    goal = np.where(np.isnan(goal).any(axis=2, keepdims=True), np.nan, goal)
    empty = np.isnan(goal).all(axis=(1, 2))
    if empty.any():
        raise DataError(f"frame {int(empty.argmax())} has no known joint ({np.count_nonzero(empty)} such frames)")
    if not all(0 <= j < len(skeleton.parents) for j in chosen) or len(set(chosen)) < len(chosen) or not chosen:
        raise DataError(f"joints {chosen}, expected different numbers from 0 to {len(skeleton.parents) - 1}")
    return goal, chosen


class _Problem:
    """What is the same for all frames."""

    def __init__(self, skeleton: Skeleton, joints: list[int], limits: bool, ridge: float) -> None:
        self.skeleton, self.joints = skeleton, joints
        self.free = np.unique(skeleton.driven[~skeleton.fixed[skeleton.driven]])
        self.sums = (skeleton.driven[:, None] == self.free).astype(float)  # (Q, F): motions of one DoF are added
        self.one_each = np.array_equal(skeleton.driven, self.free)
        self.lower = np.where(limits, skeleton.lower, -np.inf)[self.free]
        self.upper = np.where(limits, skeleton.upper, np.inf)[self.free]
        roots = [j for j, parent in enumerate(skeleton.parents) if parent < 0]
        steps = [step for j in roots for step in skeleton.steps[j]]
        self.limbs = _limbs(skeleton)
        self.root_turns = [s.dof for s in steps if s.kind == "rotate" and not skeleton.fixed[s.dof]]
        self.limb_turns = np.setdiff1d(rotations(skeleton), self.root_turns)
        self.ridge = np.where(np.isin(self.free, self.limb_turns), ridge, 0.0)
        self.root_moves = [s for s in steps if s.kind == "translate" and not skeleton.fixed[s.dof]]

    def finger_poses(self, count: int, seed: int) -> Array:
        """Inputs (count, D): the initial pose, then random ones within the limits."""
        rng = np.random.default_rng(seed)
        poses = np.zeros((count, len(self.skeleton.initial)))
        poses[1:, self.limb_turns] = self._drawn(self.limb_turns, count - 1, rng)
        return poses

    def _drawn(self, dofs: NDArray[np.int_], count: int, rng: np.random.Generator) -> Array:
        """Angles (count, len(dofs)) within the limits, and within half a turn of the initial pose."""
        low, high = np.maximum(self.skeleton.lower[dofs], -np.pi), np.minimum(self.skeleton.upper[dofs], np.pi)
        return rng.uniform(low, high, (count, len(dofs)))

    def redraw_limbs(self, inputs: Array, rng: np.random.Generator) -> Array:
        """The inputs (N, D) with new angles, within the limits, for about half of the limbs."""
        result = inputs.copy()
        for limb in self.limbs:
            drawn = rng.random(len(inputs)) < 0.5
            result[np.ix_(drawn, limb)] = self._drawn(limb, int(np.count_nonzero(drawn)), rng)
        return result

    def evaluate(self, inputs: Array, goal: Array) -> tuple[Array, Array, Array]:
        """Cost (N,), Jᵀ J + ridge (N, F, F) and its right side (N, F)."""
        pose = self.skeleton.forward(inputs)
        r = (pose.joints[self.joints].transpose(2, 0, 1) - goal).reshape(len(goal), -1)
        J = self.skeleton.jacobian(pose, self.joints)
        J = np.ascontiguousarray(J) if self.one_each else self.sums.T @ J
        unknown = np.isnan(r)
        if unknown.any():
            r[unknown] = 0
            J *= ~unknown[:, None]
        x = inputs[:, self.free]
        A = J @ J.swapaxes(1, 2)
        A[:, np.arange(len(self.free)), np.arange(len(self.free))] += self.ridge
        b = (J @ r[:, :, None])[:, :, 0] + self.ridge * x
        return (r * r).sum(axis=1) + (self.ridge * x * x).sum(axis=1), A, b

    def cost(self, inputs: Array, goal: Array) -> Array:
        """Cost (N,) alone."""
        r = np.nan_to_num(self.skeleton.forward(inputs).joints[self.joints].transpose(2, 0, 1) - goal)
        x = inputs[:, self.free]
        return np.asarray((r * r).sum(axis=(1, 2)) + (self.ridge * x * x).sum(axis=1))


class _Guess:
    """First guesses with one pose of the fingers, in all rotations of the body."""

    def __init__(self, problem: _Problem, fingers: Array) -> None:
        self.problem, sk = problem, problem.skeleton
        grid = np.arange(-np.pi, np.pi - 1e-9, GRID_STEP)
        tried = problem.root_turns[:3]  # of more there would be too many; the descent finds them
        angles = np.zeros((len(grid) ** len(tried), len(problem.root_turns)))
        angles[:, : len(tried)] = list(itertools.product(grid, repeat=len(tried)))
        if len(problem.root_turns) == 3:  # the second angle needs half a turn only: see angles.py
            angles = angles[np.abs(angles[:, 1]) <= np.pi / 2 + 1e-9]
        self.inputs = np.tile(fingers, (len(angles), 1))
        self.inputs[:, problem.root_turns] = angles - sk.initial[problem.root_turns]
        joints = sk.forward(self.inputs).joints[problem.joints].transpose(2, 0, 1)
        self.centroids = joints.mean(axis=1)
        self.shapes = (joints - self.centroids[:, None]).reshape(len(angles), -1)
        self.sizes = (self.shapes**2).sum(axis=1)

    def near(self, goal: Array) -> Array:
        """Inputs (N, D) for joints (N, K, 3)."""
        problem, centre = self.problem, np.nanmean(goal, axis=1)
        shapes = np.nan_to_num(goal - centre[:, None]).reshape(len(goal), -1)  # not known: in the middle
        best = np.argmin(self.sizes - 2 * shapes @ self.shapes.T, axis=1)
        inputs = self.inputs[best]
        for step in problem.root_moves:
            inputs[:, step.dof] += step.sign * (centre - self.centroids[best])[:, step.axis]
        inputs[:, problem.free] = np.clip(inputs[:, problem.free], problem.lower, problem.upper)
        return np.asarray(inputs)


def _limbs(skeleton: Skeleton) -> list[NDArray[np.int_]]:
    """The free rotations of each limb, which is all that hangs on one child of a root."""
    limb_of = np.arange(len(skeleton.parents))
    for joint in range(len(limb_of)):
        while skeleton.parents[limb_of[joint]] >= 0 and skeleton.parents[skeleton.parents[limb_of[joint]]] >= 0:
            limb_of[joint] = skeleton.parents[limb_of[joint]]
    dofs: dict[int, set[int]] = {}
    for joint, limb in enumerate(limb_of):
        if skeleton.parents[limb] >= 0:
            own = {step.dof for step in skeleton.steps[joint] if step.kind == "rotate" and not skeleton.fixed[step.dof]}
            dofs.setdefault(int(limb), set()).update(own)
    return [np.array(sorted(own)) for own in dofs.values() if own]


def _best(
    problem: _Problem, guesses: list[_Guess], goal: Array, starts: int, iterations: int, rng: np.random.Generator
) -> Array:
    """Inputs (N, D) of the best of all starts."""
    inputs, cost = _descend(problem, guesses[0].near(goal), goal, iterations)
    for start in range(1, starts):
        todo = np.flatnonzero(cost > EXACT**2 * len(problem.joints))
        if not len(todo):
            break
        trial = problem.redraw_limbs(inputs[todo], rng) if start % 2 else guesses[start // 2].near(goal[todo])
        found, found_cost = _descend(problem, trial, goal[todo], iterations)
        better = found_cost < cost[todo]
        inputs[todo[better]], cost[todo[better]] = found[better], found_cost[better]
    return inputs


def _descend(problem: _Problem, inputs: Array, goal: Array, iterations: int) -> tuple[Array, Array]:
    """Levenberg-Marquardt from ``inputs`` (N, D), which are used up; returns inputs (N, D) and their cost (N,)."""
    F = len(problem.free)
    cost, A, b = problem.evaluate(inputs, goal)
    mu = np.full(len(goal), 1e-2)
    active = np.arange(len(goal))  # A and b are of these
    diagonal = np.arange(F)
    for _ in range(iterations):
        x = inputs[active][:, problem.free]
        held = ((x <= problem.lower) & (b > 0)) | ((x >= problem.upper) & (b < 0))
        M = A.copy()
        M[:, diagonal, diagonal] *= 1 + mu[active, None]
        M[:, diagonal, diagonal] += 1e-12
        M[held[:, :, None] | held[:, None, :]] = 0
        M[:, diagonal, diagonal] += held
        step = np.linalg.solve(M, np.where(held, 0, -b)[:, :, None])[:, :, 0]
        trial = inputs[active]
        trial[:, problem.free] = np.clip(x + step, problem.lower, problem.upper)
        trial_cost, trial_A, trial_b = problem.evaluate(trial, goal[active])
        better = trial_cost < cost[active]
        gain = cost[active] - trial_cost
        small = gain <= SMALLEST_GAIN * cost[active]
        won = active[better]
        inputs[won], cost[won] = trial[better], trial_cost[better]
        A[better], b[better] = trial_A[better], trial_b[better]
        mu[active] *= np.where(better, 1 / 3, 4)
        np.maximum(mu, 1e-12, out=mu)
        going = ~(better & small) & (mu[active] < LARGEST_MU) & (cost[active] > 1e-24)
        active, A, b = active[going], A[going], b[going]
        if not len(active):
            break
    return inputs, cost


# ----------------------------------------------------------------------------------------------- swarm


def swarm(
    skeleton: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    particles: int = 128,
    generations: int = 200,
    seed: int = 0,
    progress: Progress = lambda done: None,
) -> Fit:
    """Fit every frame by particle swarm optimisation within the limits, as the paper did for its ground truth.

    A particle is drawn to the best place that it has seen and to the best of all, with the constriction of Clerc and
    Kennedy (2002): v <- 0.7298 (v + 2.05 u1 (own best - x) + 2.05 u2 (best - x)). The cost is the sum of squared
    distances. Arguments as for ``fit``. Raises DataError.
    """
    goal, chosen = _checked(skeleton, targets, joints)
    if particles < 1 or generations < 1:
        raise DataError(f"{particles} particles for {generations} generations, expected 1 or more")
    problem = _Problem(skeleton, chosen, limits=True, ridge=0.0)
    inputs = np.zeros((len(goal), len(skeleton.initial)))

    def job(n: int) -> None:
        inputs[n] = _swarm_of(problem, goal[n], particles, generations, np.random.default_rng([seed, n]))
        progress(1)

    parallel.run([partial(job, n) for n in range(len(goal))])
    return _result(problem, inputs, goal, limits=True)


def _swarm_of(problem: _Problem, goal: Array, particles: int, generations: int, rng: np.random.Generator) -> Array:
    """The best inputs (D,) for one frame's joints (K, 3)."""
    sk, free = problem.skeleton, problem.free
    centre = np.nanmean(goal, axis=0)
    turning = np.isin(free, rotations(sk))
    low = np.where(turning, np.maximum(problem.lower, -np.pi), problem.lower)
    high = np.where(turning, np.minimum(problem.upper, np.pi), problem.upper)
    for i, dof in enumerate(free):
        if dof in problem.root_turns:
            low[i], high[i] = -np.pi - sk.initial[dof], np.pi - sk.initial[dof]
        for step in problem.root_moves:
            if dof == step.dof:
                low[i], high[i] = step.sign * centre[step.axis] - sk.initial[dof] + np.array([-0.5, 0.5])
    low, high = np.clip((low, high), problem.lower, problem.upper)
    if not np.isfinite([low, high]).all():
        raise DataError(f"skeleton {sk.name!r} has translations without limits, where a swarm cannot begin")
    x = rng.uniform(low, high, (particles, len(free)))
    v = np.zeros_like(x)
    inputs = np.zeros((particles, len(sk.initial)))
    goals = np.broadcast_to(goal, (particles, *goal.shape))
    own, own_cost = x.copy(), np.full(particles, np.inf)
    for _ in range(generations):
        inputs[:, free] = x
        cost = problem.cost(inputs, goals)
        better = cost < own_cost
        own[better], own_cost[better] = x[better], cost[better]
        best = own[own_cost.argmin()]
        u1, u2 = rng.random((2, *x.shape))
        v = 0.7298 * (v + 2.05 * u1 * (own - x) + 2.05 * u2 * (best - x))
        x = np.clip(x + v, low, high)
    inputs[0, free] = own[own_cost.argmin()]
    return inputs[0]
