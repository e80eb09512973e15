r"""Calibrate: one person's hand, from joints annotated in many frames of that person.

A skeleton file says how long the bones are, where the fixed rotations point, how a hand is held at first, and how far
it bends. Bone lengths and fixed angles are *shared* by all frames of a person; the other angles belong to a frame. Both
are found together. With theta_n the free DoFs of frame n, and u the shared numbers as deviations from the template in
units of their spread among people (``BONE_SPREAD``, ``ANGLE_SPREAD``), the hand that explains the frames minimises

    sum_n |joints(theta_n, u) - seen_n|²  +  noise² ( w |u|²  +  sum_n |(theta_n - initial) / POSE_SPREAD|² )

by Levenberg-Marquardt, from the poses that ``handpose.fit`` finds for the template, scaled to the size of the hand.
With G_n and H_n the derivatives of frame n's joints by theta_n and by u, and r_n its residual, one step solves

    [ A_1          B_1 ] [ dtheta_1 ]     [ a_1 ]       A_n = G_nᵀ G_n + ridge      a_n = G_nᵀ r_n + ridge
    [      ...     ... ] [   ...    ] = - [ ... ]       B_n = G_nᵀ H_n
    [ B_1ᵀ ...     C   ] [    du    ]     [  c  ]       C   = sum H_nᵀ H_n + ridge  c   = sum H_nᵀ r_n + ridge

with all diagonal elements times 1 + mu. Eliminating the poses (Schur complement) leaves 51 unknowns for the NYU hand:

    (C - sum B_nᵀ A_n⁻¹ B_n) du  =  -c + sum B_nᵀ A_n⁻¹ a_n              dtheta_n = -A_n⁻¹ (a_n + B_n du)

The derivative by a fixed angle is the Jacobian's column in a skeleton in which no DoF is fixed; that by a bone's length
is the direction of the bone, for its joint and all below it.

The ridge. ``noise`` is the deviation of a coordinate in the frames, estimated from the residual before every step:
exact joints are reproduced exactly, noisy ones believed as far as they deserve. The ridge decides what the joints leave
open, and keeps that at the (scaled) template:
    - the palm's own frame: turning the whole hand one way and all that is fixed to the palm the other way, or moving
      along such null directions of an x-y-z triple in front of free rotations, changes no joint,
    - the twist of a bone that carries nothing (both points of the wrist),
    - with few joints annotated, most bones between joints that are not.
A hundred times the frames are not a hundred times the evidence: an annotator has habits, and the poses, fitted to noisy
joints, err to one side together with the bones. So w = N / INDEPENDENT_FRAMES. Of a bone's or fixed angle's spread

    noise sqrt(w diag((C - sum B_nᵀ A_n⁻¹ B_n)⁻¹))

is then left: 1 if the frames say nothing of it. Above ``UNDETERMINED`` the frames do not determine it.

A constant added to a free angle is the same hand, so initial values of free DoFs are no unknowns. They are set
afterwards, to the median of theta (rotations: around the circle), and limits to percentiles of what is then the input.
DoFs of a root, which place and turn the whole hand, keep the template's limits, that is, none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose import labels
from handpose.angles import canonical, rotations, wrap
from handpose.fit import fit
from handpose.icvl import JOINTS as ICVL_JOINTS
from handpose.nyu import CUBE_MM, EVALUATION_JOINTS
from layers.hdf5_data import read_list
from layers.kinematics import DofParameter, Skeleton, SkeletonParameter
from netlib import parallel
from netlib.errors import DataError
from netlib.prototxt import Position, Scalar

Array = NDArray[np.float64]
Progress = Callable[[int], None]

FEWEST_FRAMES = 20
BONE_SPREAD = 0.1  # deviation of a bone among people of one size, relative to its length
ANGLE_SPREAD = 0.2  # ... of a fixed angle, radians
POSE_SPREAD = 0.5  # ... of a free angle among frames, radians; a root's DoFs have no such preference
INDEPENDENT_FRAMES = 30  # so many frames count fully, more count as so many
SMALLEST_NOISE = 3e-3  # of the mean bone: no annotation is better (0.07 mm)
UNDETERMINED = 0.5  # of the spread is left
FIT_RIDGE = 1e-3  # of the poses to start from; ``handpose.fit`` says what it does

CHUNK = 128  # frames worked on together by a thread, in 40 MB
SMALLEST_GAIN = 1e-5  # relative; a step that gains less is the last
MOST_STEPS = 60
LARGEST_MU = 1e8
DECIMALS = 6  # of all numbers found, as in the packaged hand


@dataclass(frozen=True)
class Calibration:
    """A person's hand, and how sure it is.

    skeleton      the result; its numbers are rounded, so that a file gives back the same
    scale         size of the hand relative to the template, from distances that no pose changes
    start         the template scaled by it
    inputs        (N, D) of ``skeleton`` in the frames, canonical
    before        (N, K) distances of ``start``, fitted within its limits, from the joints seen; NaN where not seen
    after         (N, K) the same of ``skeleton``, without limits
    bone_spread   (all joints,) of each bone's spread among people, what is left; NaN for a joint without a bone
    angle_spread  (D,) the same of each fixed rotation; NaN for the other DoFs
    noise         deviation of a coordinate of the joints seen, in their unit
    steps         that lowered the cost
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
        """The joints whose bones the frames do not determine, so that the template decides with them."""
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
    """The hand that explains all frames best. Results do not depend on the number of threads. Raises DataError.

    template    a hand like it: says what turns about what, and decides what the frames leave open
    targets     (N, K, 3) where the joints were seen, all in one unit, which becomes the skeleton's; NaN: not seen
    joints      the K joints of the skeleton that they are; by default all
    percentile  of a DoF's inputs that becomes its lower limit; 100 less it is the upper one
    starts      how often ``fit`` starts for each frame
    seed        of those starts
    progress    is told how many frames more are fitted to the template, by any thread; most of the time goes there

    Takes some 40 kB a frame.
    """
    goal = np.asarray(targets, dtype=np.float64)
    chosen = list(range(len(template.parents))) if joints is None else list(joints)
    if len(goal) < FEWEST_FRAMES:
        raise DataError(f"{len(goal)} frames, expected {FEWEST_FRAMES} or more")
    if not 0 <= percentile < 50:
        raise DataError(f"percentile {percentile:g}, expected at least 0 and less than 50")
    if not (template.bone_axes >= 0).any():
        raise DataError(f"skeleton {template.name!r} has no bones")
    scale = size(template, goal, chosen)
    start = scaled(template, scale)
    first = fit(start, goal, chosen, ridge=FIT_RIDGE, starts=starts, seed=seed, progress=progress)
    problem = Problem(start, goal, chosen)
    state, noise, steps = _search(problem, problem.state(first.inputs))
    normal = problem.normal(state)
    angle_spread, bone_spread = problem.left(normal, state, noise)
    moved = np.diagonal(normal.A, axis1=1, axis2=2) > 0  # (N, F) a joint that was seen moves with the DoF
    skeleton, inputs = _conclude(problem, state, moved, percentile)
    found = skeleton.forward(inputs).joints[chosen].transpose(2, 0, 1)
    after = np.linalg.norm(found - goal, axis=2)
    return Calibration(skeleton, scale, start, inputs, first.residuals, after, bone_spread, angle_spread, noise, steps)


# ------------------------------------------------------------------------------------------------ template


def size(template: Skeleton, targets: Array, joints: Sequence[int]) -> float:
    """How many times as large as the template the hand with the joints (N, K, 3) is; 1 if that cannot be told.

    Only distances that no pose changes are compared, as those of the palm. Raises DataError if they are mostly 0.
    """
    if targets.ndim != 3 or targets.shape[1:] != (len(joints), 3):
        raise DataError(f"joints of shape {targets.shape}, expected (N, {len(joints)}, 3)")
    if not all(0 <= j < len(template.parents) for j in joints):
        raise DataError(f"joints {list(joints)}, expected numbers from 0 to {len(template.parents) - 1}")
    poses = np.random.default_rng(0).uniform(-1, 1, (8, len(template.initial)))
    one, other = np.triu_indices(len(joints), 1)
    placed = template.joints(poses)[:, list(joints)]
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


def scaled(skeleton: Skeleton, scale: float) -> Skeleton:
    """The skeleton with bones and initial translations ``scale`` times as long."""
    moves = {step.dof for own in skeleton.steps for step in own if step.kind == "translate"}
    dofs = [replace(d, initial=d.initial * scale) if i in moves else d for i, d in enumerate(skeleton.param.dof)]
    return rebuilt(skeleton.param, dofs, skeleton.bones * scale)


def rebuilt(param: SkeletonParameter, dofs: Sequence[DofParameter], bones: Array) -> Skeleton:
    """The skeleton with other DoFs and signed bone lengths (all joints,)."""
    joints = list(param.joint)
    for i, joint in enumerate(joints):
        if joint.bone:
            sign = -1 if joint.bone.axis.startswith("NEG_") else 1
            joints[i] = replace(joint, bone=replace(joint.bone, length=sign * float(bones[i])))
    return Skeleton(replace(param, dof=tuple(dofs), joint=tuple(joints)))


# -------------------------------------------------------------------------------------------------- search


class State(NamedTuple):
    """Where the search is."""

    theta: Array  # (N, F) input + initial of the free DoFs
    shared: Array  # (S,) deviations from the template in units of their spread: fixed angles, then bones


class Normal(NamedTuple):
    """The normal equations, without ridge and damping."""

    A: Array  # (N, F, F)
    B: Array  # (N, F, S)
    C: Array  # (S, S)
    a: Array  # (N, F)
    c: Array  # (S,)


class Problem:
    """What is the same during the whole search, and the equations of a step.

    free    (F,) the DoFs that belong to a frame
    angles  the fixed rotations, first part of the S shared numbers
    bones   the joints with a bone, second part
    """

    def __init__(self, template: Skeleton, goal: Array, joints: Sequence[int]) -> None:
        self.template, self.goal, self.joints = template, goal, list(joints)
        # Without fixed DoFs the Jacobian has columns for all; with initial values 0 the input is theta.
        everything = [replace(d, fixed=False, initial=0.0) for d in template.param.dof]
        self.open = rebuilt(template.param, everything, template.bones)
        driven, fixed = self.open.driven, template.fixed[self.open.driven]
        self.free = np.unique(driven[~fixed])
        self.angles = np.unique(driven[fixed & self.open.turns])
        self.bones = np.flatnonzero(template.bone_axes >= 0)
        # Motions of one DoF are added: (Q, F + angles).
        self.sums = (driven[:, None] == np.concatenate([self.free, self.angles])).astype(float)
        self.carries = _below(template)[self.bones][:, self.joints].astype(float)  # (bones, K)
        lengths = np.abs(template.bones[self.bones])
        self.spread = np.concatenate([np.full(len(self.angles), ANGLE_SPREAD), BONE_SPREAD * lengths])  # (S,)
        roots = np.flatnonzero(template.parents < 0)
        self.rooted = np.isin(self.free, [step.dof for j in roots for step in template.steps[j]])  # (F,)
        pulled = np.isin(self.free, rotations(template)) & ~self.rooted
        self.pose_ridge = np.where(pulled, POSE_SPREAD**-2.0, 0.0)  # (F,) times noise²
        self.shared_ridge = max(1.0, len(goal) / INDEPENDENT_FRAMES)  # times noise²
        self.known = np.asarray(~np.isnan(goal).any(axis=2))  # (N, K)
        numbers = 3 * np.count_nonzero(self.known)
        # A fitted number takes one away, unless there are so few that the ridge does.
        self.freedom = max(numbers - len(goal) * len(self.free) - len(self.spread), numbers / 4)
        self.least_noise = SMALLEST_NOISE * float(lengths.mean())
        self.blocks = parallel.blocks(len(goal), CHUNK)

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
        """(n, 3 K) of the positions (all joints, 3, n); 0 for joints that were not seen."""
        r = positions[self.joints].transpose(2, 0, 1) - self.goal[rows]
        return np.where(self.known[rows][:, :, None], r, 0.0).reshape(len(r), -1)

    def cost(self, state: State) -> tuple[float, float]:
        """The sum of squared residuals, and what noise² multiplies."""
        found = np.zeros(len(self.blocks))

        def job(i: int) -> None:
            r = self.residual(self.open.forward(*self.body(state, self.blocks[i])).joints, self.blocks[i])
            found[i] = (r * r).sum()

        parallel.run([partial(job, i) for i in range(len(self.blocks))])
        ridge = (self.pose_ridge * self._bent(state) ** 2).sum() + self.shared_ridge * (state.shared**2).sum()
        return float(found.sum()), float(ridge)

    def noise(self, squares: float) -> float:
        """Deviation of a coordinate, from the sum of squared residuals."""
        return max(float(np.sqrt(squares / self.freedom)), self.least_noise)

    def _bent(self, state: State) -> Array:
        return state.theta - self.template.initial[self.free]

    def derivative(self, state: State, rows: slice) -> tuple[Array, Array]:
        """(n, F + S, 3 K): how the joints move with theta and the shared numbers; and the residual (n, 3 K)."""
        pose = self.open.forward(*self.body(state, rows))
        n, turned = pose.joints.shape[2], self.sums.shape[1]
        J = np.empty((n, turned + len(self.bones), 3 * len(self.joints)))
        np.matmul(self.sums.T, self.open.jacobian(pose, self.joints), out=J[:, :turned])
        along = self.open.bone_directions(pose)[self.bones].transpose(2, 0, 1)  # (n, bones, 3)
        J[:, turned:] = (self.carries[:, :, None] * along[:, :, None]).reshape(n, len(self.bones), -1)
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

        parallel.run([partial(job, i) for i in range(len(self.blocks))])
        return Normal(A, B, C.sum(axis=0), a, c.sum(axis=0))

    def reduced(self, normal: Normal, state: State, noise: float, mu: float) -> tuple[Array, Array, Array, Array]:
        """The equations without the poses, with ridge and damping: matrix (S, S), right side (S,); A⁻¹ B and A⁻¹ a."""
        N, F, S = normal.B.shape
        ridge = noise**2 * self.pose_ridge
        a = normal.a + ridge * self._bent(state)
        solved = np.empty((N, F, S + 1))
        parts = np.empty((len(self.blocks), S, S + 1))
        d = np.arange(F)

        def job(i: int) -> None:
            rows = self.blocks[i]
            A = normal.A[rows].copy()
            A[:, d, d] = (1 + mu) * (A[:, d, d] + ridge) + 1e-3 * self.least_noise**2  # if nothing seen moves with it
            solved[rows] = np.linalg.solve(A, np.concatenate([normal.B[rows], a[rows, :, None]], axis=2))
            parts[i] = np.tensordot(normal.B[rows], solved[rows], axes=((0, 1), (0, 1)))

        parallel.run([partial(job, i) for i in range(len(self.blocks))])
        eliminated = parts.sum(axis=0)
        ridge_of_all = noise**2 * self.shared_ridge
        C = normal.C + np.diag(mu * np.diag(normal.C) + (1 + mu) * ridge_of_all)
        right = eliminated[:, S] - normal.c - ridge_of_all * state.shared
        return C - eliminated[:, :S], right, solved[:, :, :S], solved[:, :, S]

    def left(self, normal: Normal, state: State, noise: float) -> tuple[Array, Array]:
        """What is left of the spread of fixed rotations (D,) and bones (all joints,); NaN where there is none."""
        matrix = self.reduced(normal, state, noise, mu=0.0)[0]
        left = noise * np.sqrt(self.shared_ridge * np.diag(np.linalg.inv(matrix)))
        of_angles, of_bones = np.full(len(self.template.initial), np.nan), np.full(len(self.template.parents), np.nan)
        of_angles[self.angles], of_bones[self.bones] = np.split(left, [len(self.angles)])
        return of_angles, of_bones


def _below(skeleton: Skeleton) -> NDArray[np.bool_]:
    """(K, K): is the second joint the first one or below it?"""
    below = np.eye(len(skeleton.parents), dtype=bool)
    for joint, parent in enumerate(skeleton.parents):
        while parent >= 0:
            below[parent, joint] = True
            parent = skeleton.parents[parent]
    return below


def _search(problem: Problem, state: State) -> tuple[State, float, int]:
    """Levenberg-Marquardt from a state: where it ends, the noise there, the steps that lowered the cost."""
    squares, ridge = problem.cost(state)
    normal, mu, steps = None, 1e-3, 0
    while steps < MOST_STEPS and mu < LARGEST_MU:
        noise = problem.noise(squares)
        normal = normal or problem.normal(state)  # a step that is refused changes only mu
        matrix, right, by_shared, own = problem.reduced(normal, state, noise, mu)
        du = np.linalg.solve(matrix, right)
        trial = State(state.theta - own - by_shared @ du, state.shared + du)
        trial_squares, trial_ridge = problem.cost(trial)
        cost, trial_cost = squares + noise**2 * ridge, trial_squares + noise**2 * trial_ridge
        if not trial_cost < cost:
            mu *= 8
            continue
        state, squares, ridge, normal = trial, trial_squares, trial_ridge, None
        mu = max(mu / 4, 1e-9)
        steps += 1
        if cost - trial_cost <= SMALLEST_GAIN * cost:
            break
    return state, problem.noise(squares), steps


def _conclude(problem: Problem, state: State, moved: NDArray[np.bool_], percentile: float) -> tuple[Skeleton, Array]:
    """The skeleton with initial values and limits from the frames in which a DoF moved something; its inputs (N, D)."""
    template, turning = problem.template, rotations(problem.template)
    theta, bones = problem.body(state, slice(None))
    bones = bones[0].round(DECIMALS)
    dofs = list(template.param.dof)
    for dof in problem.angles:
        dofs[dof] = replace(dofs[dof], initial=_rounded(wrap(theta[0, dof])))
    # Of the angles that are one pose first those nearest to the template's initial ones, then to the new ones.
    skeleton = rebuilt(template.param, dofs, bones)
    theta = skeleton.theta(canonical(skeleton, theta - skeleton.initial))
    for dof, some in zip(problem.free, moved.T):
        if some.any():
            median = _circular_median(theta[some, dof]) if dof in turning else np.median(theta[some, dof])
            dofs[dof] = replace(dofs[dof], initial=_rounded(median))
    skeleton = rebuilt(template.param, dofs, bones)
    inputs = canonical(skeleton, theta - skeleton.initial)
    for dof, some, rooted in zip(problem.free, moved.T, problem.rooted):
        if some.any() and not rooted:
            lower, upper = np.percentile(inputs[some, dof], (percentile, 100 - percentile))
            dofs[dof] = replace(dofs[dof], lower=_rounded(lower), upper=_rounded(upper))
    return rebuilt(template.param, dofs, bones), inputs


def _circular_median(angles: Array) -> float:
    """The median of angles, counted from the opposite of their mean direction; in (-pi, pi]."""
    mean = np.angle(np.exp(1j * angles).mean())
    return float(wrap(mean + np.median(wrap(angles - mean))))


def _rounded(number: ArrayLike) -> float:
    return round(float(np.asarray(number)), DECIMALS)


# --------------------------------------------------------------------------------------------------- files

# Joints of a skeleton that files of fewer joints hold, by the numbers of both.
PARTS = {(31, 14): EVALUATION_JOINTS, (21, len(ICVL_JOINTS)): tuple(range(len(ICVL_JOINTS)))}


@dataclass(frozen=True)
class Annotation:
    """Annotated frames, as HDF5 files have them.

    targets    (N, K, 3) half-cubes of each frame, from the crop centre; NaN where cut off by the cube, or unknown
    joints     (K,) which joints of the skeleton they are
    half_cube  (N,) mm
    unseen     how many joints these are
    rows       how many frames the files have
    """

    targets: Array
    joints: tuple[int, ...]
    half_cube: Array
    unseen: int
    rows: int


def read_annotation(
    path: str | Path,
    skeleton: Skeleton,
    joints: int | None = None,
    frames: int | None = None,
    seed: int = 0,
    half_cube: float = CUBE_MM / 2,
) -> Annotation:
    """Joints from an HDF5 file, or from those that a list (.txt) names. Raises DataError.

    joints     use so many: those of PARTS; by default all that there are
    frames     take so many at random, by default all; only such whose cube holds half of the joints or more
    half_cube  mm, where the file does not say
    """
    files = read_list(str(path), None) if Path(path).suffix == ".txt" else [Path(path)]
    K = len(skeleton.parents)
    known = {K: tuple(range(K)), **{few: part for (all_, few), part in PARTS.items() if all_ == K}}
    parts = [labels.read(file, known, half_cube) for file in files]
    counts = sorted({part.joints.shape[1] for part in parts})
    if len(counts) > 1:
        raise DataError(f"{path}: some files have {counts[0]} joints, others {counts[-1]}; expected as many in all")
    there = known[counts[0]]
    chosen = there if joints is None else known.get(joints, ())
    if not chosen or not set(chosen) <= set(there):
        raise DataError(f"{path}: has {len(there)} joints of a skeleton of {K}; {joints} cannot be taken of them")
    columns = [there.index(j) for j in chosen]
    stored = np.concatenate([part.joints for part in parts])[:, columns]
    half = np.concatenate([part.half_cube for part in parts])
    unseen = ~np.concatenate([part.seen for part in parts])[:, columns]
    usable = np.flatnonzero(2 * unseen.sum(axis=1) <= len(chosen))
    if len(usable) < FEWEST_FRAMES:
        raise DataError(
            f"{path}: {len(usable)} of {len(stored)} frames have half of their joints within the cube (-1 to 1), "
            f"expected {FEWEST_FRAMES} or more"
        )
    if frames is not None and frames < len(usable):
        usable = np.sort(np.random.default_rng(seed).choice(usable, frames, replace=False))
    targets = np.where(unseen[usable][:, :, None], np.nan, stored[usable])
    return Annotation(targets, chosen, half[usable], int(unseen[usable].sum()), len(stored))


def skeleton_text(skeleton: Skeleton, name: str, comment: str) -> str:
    """A file like the packaged ones, of this name and with a comment at the top; numbers are rounded."""
    param = skeleton.param
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [f"name: {_quoted(name)}", ""]
    width = max((len(_quoted(d.name)) for d in param.dof), default=0)
    for i, d in enumerate(param.dof):
        fields = [f"name: {_quoted(d.name).ljust(width)}", f"initial: {_number(d.initial).rjust(9)}"]
        fields += ["fixed: true"] if d.fixed else [f"lower: {_number(d.lower)} upper: {_number(d.upper)}"]
        lines.append(f"dof {{ {'  '.join(fields)} }}  # {i}")
    lines += ["", f"# Joints in output order: {len(param.joint)} x (x, y, z)."]
    for i, j in enumerate(param.joint):
        parent = f" parent: {_quoted(j.parent)}" if j.parent is not None else ""
        lines += [f"joint {{  # {i}", f"  name: {_quoted(j.name)}{parent}"]
        for kind, motions in (("translate", j.translate), ("rotate", j.rotate)):
            lines += [f"  {kind} {{ axis: {motion.axis} dof: {_quoted(motion.dof)} }}" for motion in motions]
        if j.bone:
            lines.append(f"  bone {{ axis: {j.bone.axis} length: {_number(j.bone.length)} }}")
        lines.append("}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return str(Scalar("string", text, Position("", 1, 1)))


def _number(number: float) -> str:
    return str(int(number)) if float(number).is_integer() else f"{number:.{DECIMALS}f}"
