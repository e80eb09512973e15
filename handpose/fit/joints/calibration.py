"""Calibrate the skeleton of one person's hand, from joints annotated in many frames of that person.

A skeleton file has the bone lengths, the fixed rotations, the initial pose and the limits. Bones, fixed rotations and
the pose of every frame are estimated together (``calibration_problem``), from the poses that ``fit_joints`` finds for
the template, scaled to the size of the hand.

What the joints do not determine stays at the (scaled) template:
    - the root's own frame: rotating the whole hand one way and everything fixed to the root the other way, or moving
      along such null directions of an x-y-z triple in front of free rotations, changes no joint,
    - the twist of a bone without children,
    - with few joints annotated, most bones between joints that are not.
A bone or fixed rotation whose remaining spread is above ``UNDETERMINED`` of that among people is not determined.

A constant added to a free angle gives the same hand, so initial values of free DoFs are not estimated. They are set
afterwards, to the median of theta (rotations: around the circle), and limits to percentiles of the resulting input.
DoFs of a root, which place and turn the whole hand, keep the template's limits: none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.fit.joints.angles import canonical, rotations, wrap
from handpose.fit.joints.calibration_problem import BONE_SPREAD, MIN_FRAMES, CalibrationProblem, State
from handpose.fit.joints.fit_joints import fit_joints
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import DECIMALS
from netlib.blob import Array
from netlib.errors import DataError
from netlib.proto import schema

Progress = Callable[[int], None]

UNDETERMINED = 0.5  # remaining share of the spread
FIT_RIDGE = 1e-3  # ridge of the initial fits, see ``fit_joints``

MIN_GAIN = 1e-5  # relative; a step that gains less is the last
MAX_STEPS = 60
# Damping, as in levenberg_marquardt.py. A rejected step needs no new normal equations, so it may raise mu by more. The
# factors 1/4 and 8 need the fewest evaluations; 1/3 and 4, or 1/10 and 10, up to a quarter more for the same hands.
FIRST_MU, TRUST, DOUBT = 1e-3, 1 / 4, 8
MIN_MU, MAX_MU = 1e-9, 1e8


@dataclass(frozen=True)
class Calibration:
    """A person's hand and its uncertainty.

    skeleton      the result; its numbers are rounded, so that a file gives back the same
    scale         size of the hand relative to the template, from distances that do not depend on the pose
    start         the template scaled by it
    inputs        (N, D) of ``skeleton`` in the frames, canonical
    before        (N, K) distances of ``start``, fitted within its limits, from the visible joints; NaN for others
    after         (N, K) distances of ``skeleton`` without limits, likewise
    bone_spread   (all joints,) remaining share of each bone's spread among people; NaN for a joint without a bone
    angle_spread  (D,) remaining share for each fixed rotation; NaN for the other DoFs
    noise         standard deviation of a coordinate of the visible joints, in their unit
    steps         number of steps that lowered the cost
    """

    skeleton: Skeleton
    scale: float
    start: Skeleton
    inputs: Array
    before: Array
    after: Array
    bone_spread: Array
    angle_spread: Array
    noise: float
    steps: int

    @property
    def bone_deviation(self) -> Array:
        """(all joints,) standard deviation of each bone, in the unit of the joints; NaN for a joint without a bone."""
        return np.asarray(self.bone_spread * BONE_SPREAD * np.abs(self.start.bones))

    @property
    def undetermined_bones(self) -> list[str]:
        """The joints whose bones the frames do not determine, so that the template also contributes."""
        return [name for name, left in zip(self.skeleton.joint_names, self.bone_spread) if left > UNDETERMINED]

    @property
    def undetermined_angles(self) -> list[str]:
        """The fixed rotations that the frames do not determine."""
        return [name for name, left in zip(self.skeleton.dof_names, self.angle_spread) if left > UNDETERMINED]


def calibrate(
    template: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    percentile: float = 0.5,
    starts: int = 8,
    seed: int = 0,
    progress: Progress = lambda done: None,
) -> Calibration:
    """Estimate the hand that explains all frames best. Independent of the number of threads. Raises DataError.

    template    a similar hand: its structure is used, and its values where the frames determine nothing
    targets     (N, K, 3) joints, all in one unit, which becomes the skeleton's; NaN: not visible
    joints      indices of the K joints in the skeleton; by default all
    percentile  of a DoF's inputs that becomes its lower limit; 100 less it is the upper one
    starts      number of starts of ``fit_joints`` for each frame
    seed        of those starts
    progress    called by any thread with the number of further frames fitted to the template (most of the time)

    Takes about 40 kB per frame.
    """
    goal = np.asarray(targets, dtype=np.float64)
    chosen = list(range(len(template.parents))) if joints is None else list(joints)
    if len(goal) < MIN_FRAMES:
        raise DataError(f"{len(goal)} frames, expected {MIN_FRAMES} or more")
    if not 0 <= percentile < 50:
        raise DataError(f"percentile {percentile:g}, expected at least 0 and less than 50")
    if not (template.bone_axes >= 0).any():
        raise DataError(f"skeleton {template.name!r} has no bones")
    scale = size(template, goal, chosen)
    start = template.scaled(scale)
    first = fit_joints(start, goal, chosen, ridge=FIT_RIDGE, starts=starts, seed=seed, progress=progress)
    problem = CalibrationProblem(start, goal, chosen)
    state, noise, steps = _search(problem, problem.state(first.inputs))
    normal = problem.normal(state)
    angle_spread, bone_spread = problem.left(normal, state, noise)
    moved = np.diagonal(normal.A, axis1=1, axis2=2) > 0  # (N, F) a visible joint moves with the DoF
    skeleton, inputs = _conclude(problem, state, moved, percentile)
    found = kinematics_of(skeleton).forward(inputs).joints[:, chosen]
    after = np.linalg.norm(found - goal, axis=2)
    return Calibration(skeleton, scale, start, inputs, first.residuals, after, bone_spread, angle_spread, noise, steps)


def size(template: Skeleton, targets: Array, joints: Sequence[int]) -> float:
    """The size of the hand with the joints (N, K, 3) relative to the template; 1 if it cannot be determined.

    Only distances that do not depend on the pose are compared, such as those along one bone. Raises DataError if they
    are mostly 0.
    """
    if targets.ndim != 3 or targets.shape[1:] != (len(joints), 3):
        raise DataError(f"joints of shape {targets.shape}, expected (N, {len(joints)}, 3)")
    if not all(0 <= j < len(template.parents) for j in joints):
        raise DataError(f"joints {list(joints)}, expected numbers from 0 to {len(template.parents) - 1}")
    poses = np.random.default_rng(0).uniform(-1, 1, (8, len(template.initial)))
    one, other = np.triu_indices(len(joints), 1)
    placed = kinematics_of(template).joints(poses)[:, list(joints)]
    distances = np.linalg.norm(placed[:, one] - placed[:, other], axis=2)
    rigid = np.ptp(distances, axis=0) < 1e-9 * distances.max(initial=0)
    own, one, other = distances[0, rigid], one[rigid], other[rigid]
    seen = np.linalg.norm(targets[:, one] - targets[:, other], axis=2)
    sums = (~np.isnan(seen) * own).sum(axis=1)
    some = sums > 0
    if not some.any():
        return 1.0
    scale = float(np.median(np.nansum(seen, axis=1)[some] / sums[some]))
    if not scale > 0:
        raise DataError("in most frames the joints are all in one place")
    return scale


def _search(problem: CalibrationProblem, state: State) -> tuple[State, float, int]:
    """Levenberg-Marquardt from a state; returns the last state, its noise, and the number of accepted steps."""
    squares, ridge = problem.cost(state)
    normal, mu, steps = None, FIRST_MU, 0
    while steps < MAX_STEPS and mu < MAX_MU:
        noise = problem.noise(squares)
        normal = normal or problem.normal(state)  # a rejected step changes only mu
        matrix, right, by_shared, own = problem.reduced(normal, state, noise, mu)
        du = np.linalg.solve(matrix, right)
        trial = State(state.theta - own - by_shared @ du, state.shared + du)
        trial_squares, trial_ridge = problem.cost(trial)
        cost, trial_cost = squares + noise**2 * ridge, trial_squares + noise**2 * trial_ridge
        if not trial_cost < cost:
            mu *= DOUBT
            continue
        state, squares, ridge, normal = trial, trial_squares, trial_ridge, None
        mu = max(mu * TRUST, MIN_MU)
        steps += 1
        if cost - trial_cost <= MIN_GAIN * cost:
            break
    return state, problem.noise(squares), steps


def _conclude(
    problem: CalibrationProblem, state: State, moved: NDArray[np.bool_], percentile: float
) -> tuple[Skeleton, Array]:
    """The skeleton with initial values and limits from the frames in which a DoF moved something; its inputs (N, D)."""
    template, turning = problem.template, rotations(problem.template)
    theta, bones = problem.body(state, slice(None))
    bones = bones[0].round(DECIMALS)
    dofs = list(template.param.dof)
    for dof in problem.angles:
        dofs[dof] = schema.changed(dofs[dof], initial=_rounded(wrap(theta[0, dof])))
    # Of equivalent angles take first those nearest to the template's initial ones, then to the new ones.
    skeleton = template.with_numbers(dofs, bones)
    theta = skeleton.theta(canonical(skeleton, theta - skeleton.initial))
    for dof, some in zip(problem.free, moved.T):
        if some.any():
            median = _circular_median(theta[some, dof]) if dof in turning else np.median(theta[some, dof])
            dofs[dof] = schema.changed(dofs[dof], initial=_rounded(median))
    skeleton = template.with_numbers(dofs, bones)
    inputs = canonical(skeleton, theta - skeleton.initial)
    for dof, some, rooted in zip(problem.free, moved.T, problem.rooted):
        if some.any() and not rooted:
            lower, upper = np.percentile(inputs[some, dof], (percentile, 100 - percentile))
            dofs[dof] = schema.changed(dofs[dof], lower=_rounded(lower), upper=_rounded(upper))
    return template.with_numbers(dofs, bones), inputs


def _circular_median(angles: Array) -> float:
    """The median of angles, counted from the opposite of their mean direction; in (-pi, pi]."""
    mean = np.angle(np.exp(1j * angles).mean())
    return float(wrap(mean + np.median(wrap(angles - mean))))


def _rounded(number: ArrayLike) -> float:
    return round(float(np.asarray(number)), DECIMALS)
