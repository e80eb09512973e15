"""Fit a skeleton to given joints by Levenberg-Marquardt, many frames at once.

The inputs x are searched for which the model's joints are at given positions. With r the
differences (3 k) of the chosen joints and J their derivative by the F free DoFs, (F, 3 k) as in
``Kinematics.jacobian``, the cost of a frame is

    |r|² + ridge |x|²                gradient / 2  =  b  =  J r + ridge x        A  =  J Jᵀ + ridge

Joints that are unknown in a frame are left out of r and J. Everything is in the unit of the
skeleton's bones: half-cubes for the NYU hand. The steps are those of ``handpose.fit.search``.

The cost has many local minima, and each start (``starts``) leads to one. The first is near the
goal: the rotation of the whole body, from a grid, that brings the joints closest after aligning
centroids, with the limbs' initial pose (one product of all frames with all rotations finds it).
Then in turn the best pose so far with about half of its limbs drawn again, and a start near the
goal with all limbs drawn.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.fit.joints.angles import canonical, rotations
from handpose.fit.search import minimise
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, blocks
from netlib.engine import for_each
from netlib.errors import DataError

CHUNK = 256  # frames per job of a thread
SEED = 0  # of the random starts
GRID_STEP = np.pi / 6  # angle between the rotations of the grid
MAX_ITERATIONS = 100  # maximum number per start
COST_TOLERANCE = 1e-7  # relative; a frame whose cost decreases by less is finished
EXACT = 5e-6  # root mean square distance of the joints at which a frame needs no other start
MIN_MU = 1e-12  # minimum damping; below it a step equals Gauss-Newton's, up to rounding
DEFAULT_RIDGE = 1e-12  # if no known joint moves with an angle, its step is 0 / 1e-12


class JointFit(NamedTuple):
    """The best pose of every frame.

    inputs     (N, D) canonical inputs of the model, within its limits if they were kept; radians
               and units of the bones; fixed DoFs 0
    residuals  (N, K) distance of each chosen joint from its target, in the same unit;
               NaN if unknown
    """

    inputs: Array
    residuals: Array


class PoseProblem:
    """The constants of the fit for all frames.

    free        (F,) the DoFs that are fitted
    lower, upper  (F,) their limits, infinite without limits
    ridge       (F,) weight of the squared inputs: 0 except for rotations of limbs
    root_turns  the DoFs that rotate the whole body
    root_moves  the motions that translate it
    limb_turns  the DoFs of all other rotations
    """

    def __init__(
        self, skeleton: Skeleton, joints: Sequence[int], limits: bool, ridge: float
    ) -> None:
        self.skeleton = skeleton
        self.joints = list(joints)
        self.kinematics = kinematics_of(skeleton)
        self.free = np.unique(skeleton.driven)
        # (Q, F): motions of one DoF are added
        self.sums = (skeleton.driven[:, None] == self.free).astype(float)
        self.lower = np.where(limits, skeleton.lower, -np.inf)[self.free]
        self.upper = np.where(limits, skeleton.upper, np.inf)[self.free]
        roots = np.flatnonzero(skeleton.parents < 0)
        motions = [motion for j in roots for motion in skeleton.motions[j] if motion.row >= 0]
        self.root_turns = [motion.dof for motion in motions if motion.kind == "rotate"]
        self.root_moves = [motion for motion in motions if motion.kind == "translate"]
        self.limb_turns = np.setdiff1d(rotations(skeleton), self.root_turns)
        self.ridge = np.where(np.isin(self.free, self.limb_turns), ridge, 0.0)

    def evaluate(self, inputs: Array, goal: Array) -> tuple[Array, Array, Array]:
        """Cost (N,), A (N, F, F) and b (N, F) of inputs (N, D), for target joints (N, K, 3)."""
        pose = self.kinematics.forward(inputs)
        r = (pose.joints[:, self.joints] - goal).reshape(len(goal), -1)
        J = self.kinematics.jacobian(pose, self.joints)
        J = self.sums.T @ J
        unknown = np.isnan(r)
        if unknown.any():
            r[unknown] = 0
            J *= ~unknown[:, None]
        x = inputs[:, self.free]
        A = J @ J.swapaxes(1, 2)
        diagonal = np.arange(len(self.free))
        A[:, diagonal, diagonal] += self.ridge
        b = (J @ r[:, :, None])[:, :, 0] + self.ridge * x
        pull = (self.ridge * x * x).sum(axis=1)
        return (r * r).sum(axis=1) + pull, A, b

    def cost(self, inputs: Array, goal: Array) -> Array:
        """Cost (N,) alone."""
        r = np.nan_to_num(self.kinematics.forward(inputs).joints[:, self.joints] - goal)
        x = inputs[:, self.free]
        pull = (self.ridge * x * x).sum(axis=1)
        return (r * r).sum(axis=(1, 2)) + pull

    def result(self, inputs: Array, goal: Array, limits: bool) -> JointFit:
        """Inputs (N, D) in canonical form, within the limits or not, and their distances from the
        targets (N, K, 3).
        """
        final = canonical(self.skeleton, inputs, limits=limits)
        # canonical form may exceed a limit by rounding
        final[:, self.free] = np.clip(final[:, self.free], self.lower, self.upper)
        found = self.kinematics.forward(final).joints[:, self.joints]
        return JointFit(final, np.linalg.norm(found - goal, axis=2))


def fit_joints(
    skeleton: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    limits: bool = True,
    ridge: float = 0.0,
    starts: int = 8,
    progress: Callable[[int], None] = lambda done: None,
) -> JointFit:
    """Fit every frame independently.

    Results do not depend on the number of threads. Raises DataError.

    targets   (N, K, 3) joint positions; NaN for a joint that is unknown in a frame
    joints    indices of the K joints in the skeleton; by default all
    limits    keep the inputs within the skeleton's limits
    ridge     weight of the squared inputs (rotations of limbs) relative to the squared distances:
              pulls angles that the joints hardly determine towards the initial pose
    starts    number of starts; a frame that fits exactly is not started again
    progress  called by any thread with the number of further frames that are done
    """
    goal, chosen = checked(skeleton, targets, joints)
    problem = PoseProblem(skeleton, chosen, limits, ridge)
    grids = [RotationGrid(problem, limbs) for limbs in _limb_poses(problem, 1 + (starts - 1) // 2)]
    inputs = np.zeros((len(goal), len(skeleton.initial)))

    def job(rows: slice) -> None:
        rng = np.random.default_rng([SEED, rows.start])
        inputs[rows] = _best(problem, grids, goal[rows], starts, rng)
        progress(rows.stop - rows.start)

    for_each(blocks(len(goal), CHUNK), job)
    return problem.result(inputs, goal, limits)


def fit_absolute(
    skeleton: Skeleton,
    xyz: Array,
    half_cube: Array,
    joints: Sequence[int],
    *,
    fit: Callable[..., JointFit] = fit_joints,
    **options: Any,
) -> tuple[JointFit, Array]:
    """Fit the hand to joints (N, K, 3) in mm, whose unit of the skeleton is ``half_cube`` (N,) mm.

    Raises DataError, also for a joint that is not finite.

    joints   indices of the K joints in the skeleton
    fit      ``fit_joints`` or ``fit_joints_by_swarm``, with its options

    Returns the fit with its residuals in mm, and the origin (N, 3) of its inputs in mm: the mean of
    the joints, because there is no crop.
    """
    center = xyz.mean(axis=1, keepdims=True)
    found = fit(skeleton, (xyz - center) / half_cube[:, None, None], joints, **options)
    return found._replace(residuals=found.residuals * half_cube[:, None]), center[:, 0]


def _best(
    problem: PoseProblem,
    grids: Sequence[RotationGrid],
    goal: Array,
    starts: int,
    rng: np.random.Generator,
) -> Array:
    """Inputs (N, D) of the best of all starts."""
    inputs, cost = _descend(problem, grids[0].near(goal), goal)
    for start in range(1, starts):
        todo = np.flatnonzero(cost > EXACT**2 * len(problem.joints))
        if not len(todo):
            break
        goals = goal[todo]
        trial = (
            _redrawn_limbs(problem.skeleton, inputs[todo], rng)
            if start % 2
            else grids[start // 2].near(goals)
        )
        found, found_cost = _descend(problem, trial, goals)
        better = found_cost < cost[todo]
        inputs[todo[better]], cost[todo[better]] = found[better], found_cost[better]
    return inputs


def _descend(problem: PoseProblem, inputs: Array, goal: Array) -> tuple[Array, Array]:
    """Minimise from ``inputs`` (N, D); returns inputs (N, D) and their cost (N,)."""

    def evaluate(x: Array, rows: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        trial = inputs[rows]
        trial[:, problem.free] = x
        return problem.evaluate(trial, goal[rows])

    x, cost = minimise(
        evaluate,
        inputs[:, problem.free],
        problem.lower,
        problem.upper,
        MAX_ITERATIONS,
        ridge=DEFAULT_RIDGE,
        min_mu=MIN_MU,
        min_gain=COST_TOLERANCE,
    )
    found = inputs.copy()
    found[:, problem.free] = x
    return found, cost


def checked(
    skeleton: Skeleton, targets: ArrayLike, joints: Sequence[int] | None
) -> tuple[Array, list[int]]:
    """Joint positions (N, K, 3), all NaN for an unknown joint, and the K chosen joints.

    Raises DataError.
    """
    goal = np.asarray(targets, dtype=np.float64)
    chosen = list(range(len(skeleton.parents))) if joints is None else list(joints)
    if goal.ndim != 3 or goal.shape[1:] != (len(chosen), 3):
        raise DataError(f"joints of shape {goal.shape}, expected (N, {len(chosen)}, 3)")
    infinite = np.isinf(goal).any(axis=(1, 2))
    if infinite.any():
        raise DataError(f"frame {int(infinite.argmax())} has an infinite joint")
    goal = np.where(np.isnan(goal).any(axis=2, keepdims=True), np.nan, goal)
    empty = np.isnan(goal).all(axis=(1, 2))
    if empty.any():
        raise DataError(
            f"frame {int(empty.argmax())} has no known joint ({np.count_nonzero(empty)} such frames)"
        )
    return goal, chosen


class RotationGrid:
    """First guesses with one pose of the limbs, inputs (D,), in all rotations of the body."""

    def __init__(self, problem: PoseProblem, limbs: Array) -> None:
        self.problem = problem
        sk = problem.skeleton
        grid = np.arange(-np.pi, np.pi - 1e-9, GRID_STEP)
        angles = np.array(list(itertools.product(grid, repeat=len(problem.root_turns))))
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
        problem = self.problem
        centre = np.nanmean(goal, axis=1)
        # an unknown joint counts as one at the centre
        shapes = np.nan_to_num(goal - centre[:, None]).reshape(len(goal), -1)
        best = np.argmin(self.sizes - 2 * shapes @ self.shapes.T, axis=1)
        inputs = self.inputs[best]
        for motion in problem.root_moves:
            inputs[:, motion.dof] += motion.sign * (centre - self.centroids[best])[:, motion.axis]
        inputs[:, problem.free] = np.clip(inputs[:, problem.free], problem.lower, problem.upper)
        return inputs


def _limb_poses(problem: PoseProblem, count: int) -> Array:
    """Inputs (count, D): the initial pose, then random ones within the limits."""
    rng = np.random.default_rng(SEED)
    poses = np.zeros((count, len(problem.skeleton.initial)))
    poses[1:, problem.limb_turns] = _drawn(problem.skeleton, problem.limb_turns, count - 1, rng)
    return poses


def _redrawn_limbs(skeleton: Skeleton, inputs: Array, rng: np.random.Generator) -> Array:
    """The inputs (N, D) with new angles, within the limits, for about half of the limbs."""
    result = inputs.copy()
    for limb in _limbs(skeleton):
        drawn = rng.random(len(inputs)) < 0.5
        result[np.ix_(drawn, limb)] = _drawn(skeleton, limb, int(np.count_nonzero(drawn)), rng)
    return result


def _limbs(skeleton: Skeleton) -> list[NDArray[np.int_]]:
    """The free rotations of each limb, the subtree of one child of a root."""
    children = np.flatnonzero(np.isin(skeleton.parents, np.flatnonzero(skeleton.parents < 0)))
    found = []
    for joints in sorted(
        np.flatnonzero(skeleton.descendants[child]).tolist() for child in children
    ):
        own = {
            m.dof
            for joint in joints
            for m in skeleton.motions[joint]
            if m.kind == "rotate" and m.row >= 0
        }
        found.append(np.array(sorted(own), dtype=int))
    return [own for own in found if len(own)]


def _drawn(
    skeleton: Skeleton, dofs: NDArray[np.int_], count: int, rng: np.random.Generator
) -> Array:
    """Angles (count, len(dofs)) within the limits, and within half a turn of the initial pose."""
    low, high = np.maximum(skeleton.lower[dofs], -np.pi), np.minimum(skeleton.upper[dofs], np.pi)
    return rng.uniform(low, high, (count, len(dofs)))
