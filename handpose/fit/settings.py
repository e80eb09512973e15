"""The tuned numbers of finding and fitting hands: ``load_predictor`` passes them down to where they
are used.

A tuned number was chosen by its effect on hands. ``python -m experiments constants`` lists and
counts all, and measures with others; experiments/constants.py has what groups of them gain.
Numbers that are not tuned are constants of the modules that use them: units, bounds of rounding and
of convergence, sizes of blocks, limits of what is accepted, what the training data have, and
thresholds that choose only the words of a message. What a user chooses is an argument of
``Predictor`` and ``Tracker``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

PLANS = ("fast", "accurate")  # the names of plans
Fit = Literal["no", "fast", "accurate"]  # the name of a plan, or "no" for the network alone


class Stage(NamedTuple):
    """A number of iterations with one robust distance; a fit ends earlier once its cost decreases
    by too little.
    """

    robust: float  # mm
    iterations: int
    min_gain: float | None = None  # relative decrease of the cost in an iteration; None: any


class Trials(NamedTuple):
    """How all starts are tried before the best continue.

    turns  number of quarter turns of the crop for the network, from 0, the unchanged crop
    draws  number of further starts, drawn about the first prediction from the network's errors
    thin   the points are subsampled by this factor
    stage  of all starts
    keep   number of starts that continue
    """

    turns: int
    draws: int
    thin: int
    stage: Stage
    keep: int


@dataclass(frozen=True)
class Plan:
    """The plan of a search.

    name        of the plan
    points      number of points sampled from a frame
    iterations  of the starts that continue, on all points
    trials      before it; None: there is one start
    min_gain    as in ``Stage``
    """

    name: str
    points: int
    iterations: int
    trials: Trials | None = None
    min_gain: float | None = None

    @property
    def quarters(self) -> range:
        """The quarter turns of the crop for the network."""
        return range(self.trials.turns if self.trials else 1)


@dataclass(frozen=True)
class SearchSettings:
    """How a fit moves, and its plans (``search``)."""

    # The nearest points slide along the surface as it moves, so a step is too short, and the next
    # one has the same direction: factor of a step, and part of the previous step that is added.
    step_factor: float = 1.5
    momentum: float = 0.2
    robust: float = 13.0  # mm, the robust distance at the end
    # iterations from a start that is close, and when they end earlier: ``Stage``
    refining_iterations: int = 4
    min_gain: float = 0.02
    fast: Plan = Plan("fast", 300, 6)
    accurate: Plan = Plan("accurate", 400, 5, Trials(4, 6, 4, Stage(15.0, 5), 2))

    @property
    def plans(self) -> dict[str, Plan]:
        """The plans by their names."""
        return {plan.name: plan for plan in (self.fast, self.accurate)}


@dataclass(frozen=True)
class Weights:
    """The weights of the terms of the ``objective``, chosen on synthetic frames that are in no
    reported result; ``outline``, ``beyond`` and ``poses`` also on real recordings: docs/fit.md.

    For a body in a cube larger than a hand's, lengths in mm and the robust distance are
    scaled accordingly.
    """

    # mm, deviation of capsules from a real surface: the unit of the first three terms
    sigma: float = 4.0
    independent: float = 150.0  # effective number of independent points in a frame
    outline: float = 2.0  # of spheres outside the silhouette
    front: float = 0.1  # of spheres in front of the surface
    slack: float = 3.0  # mm that a sphere may extend into free space
    beyond: float = 0.3  # of points on capsules beyond the skeleton's joints
    limbs: float = 1.0  # of the limbs near the predicted angles
    poses: float = 0.5  # of natural poses
    rigid: float = 14.0  # mm, deviation of each coordinate of the ends that move with the root
    size: float = 0.08  # deviation of the logarithm of the size; 0: it is known
    thickness: float = 0.08  # deviation of the logarithm of the thickness


@dataclass(frozen=True)
class JointStartSettings:
    """Starts from predicted joints (``joint_starts``): the result depends little on the numbers."""

    joint_mm: float = 10.0  # deviation of the joints
    limb: float = 0.6  # radians, deviation of the limbs from the predicted angles
    size_std: float = 0.1  # deviation of the logarithm of the size
    steps: int = 4  # of Levenberg-Marquardt


@dataclass(frozen=True)
class SteadySettings:
    """Fits that start from the pose that is expected from earlier frames."""

    # factor of the cost at the expected pose, so that fits do not jump between two equally good
    # poses
    cost_factor: float = 0.9
    # precision of the expected limbs in ``DepthFitter.follow``, relative to that of the network's
    # limbs: those that are hardly visible would jitter
    limb_precision: float = 5.0


@dataclass(frozen=True)
class SupportSettings:
    """The comparison of poses with readings (``support``)."""

    tolerance_mm: float = 20.0  # a reading this far from the surface of a fit is of something else
    max_joint_depth_mm: float = 80.0  # maximum contribution of a joint to ``JointDepths``
    self_mm: float = 5.0  # a sphere this far in front of another covers it


@dataclass(frozen=True)
class JudgeSettings:
    """The confidence of poses of which little was seen, and of sides. The numbers for sides were
    chosen on P3, P7 and hpx.
    """

    # Share of a hand's own surface that was seen at its place, below which the confidence falls in
    # proportion. Parts of the tracked hands of P1, P3, P4 and P6 were covered or not read for 0.2
    # s: where 20 to 40% were seen, 68% of the poses were within 30 mm, with a mean confidence of
    # 62%; where less was seen 29%, with 70%. In P7, on which it was not chosen, the confidence of
    # such hands remains too high: 58% where 70% or less was seen, and 14% within 30 mm.
    least_shown: float = 0.3
    # The side of a hand is judged by the log-ratio of the costs of the fits as either side: the
    # maximum contribution of one frame, and the slope of the log-odds of a side by the mean ratio.
    max_ratio: float = 0.5
    side_slope: float = 8.0


@dataclass(frozen=True)
class CropSettings:
    """How far a crop moves from its start, which is in the hand: a prediction farther away is
    wrong.
    """

    max_move_mm: float = 60.0
    # from a finder's place, which is the middle of the joints, in two real frames of NYU 92 and
    # 103 mm from the place of NYU's crops, near the wrist
    from_middle_mm: float = 120.0


@dataclass(frozen=True)
class ExpectedSettings:
    """When a crop is completed by the body that is expected in it (``ExpectedBodies``)."""

    # The minimum share of an expected surface without a reading, and the minimum share of the
    # crop's readings that it explains: otherwise the hand itself has moved. In the ordinary frames
    # of CVAR's P1, P3, P4, P6 and P7 the first is at most 0.2 in 99%, in hpx, whose hands have
    # holes, up to 0.34; with 0.25 and 0.35 errors are alike. The second was chosen on frames of P1,
    # P4 and P6 of which a part was not read.
    unread: float = 0.25
    explained: float = 0.5
    around_mm: float = 15.0  # pixels without a reading this close to it may be of it
    # minimum share of the expected surface behind nearer readings: fewer are reflections,
    # mostly next to it
    hiding: float = 0.08
    # share of its surface outside the image: what is not read of the hand may be there, too
    leaving: float = 0.05


@dataclass(frozen=True)
class FinderSettings:
    """The hands that a finder's outputs mean."""

    apart_mm: float = 70.0  # middles closer than this are one hand
    # Weight in a fit of pixels that are no hand. In 115 hands of rendered scenes 0 to 0.4 give
    # joints to 39 to 45% of those found, 1 to 38%; the right side in 71 to 80%, with 1 in 69%.
    doubt: float = 0.05


@dataclass(frozen=True)
class FitSettings:
    """All tuned numbers of a ``Predictor``."""

    search: SearchSettings = SearchSettings()
    objective: Weights = Weights()
    joint_starts: JointStartSettings = JointStartSettings()
    steady: SteadySettings = SteadySettings()
    # sampling is denser near the outline, 1 / (thin_px + distance in px), because limbs are thin
    thin_px: float = 3.0
    support: SupportSettings = SupportSettings()
    judge: JudgeSettings = JudgeSettings()
    crops: CropSettings = CropSettings()
    expected: ExpectedSettings = ExpectedSettings()
    finder: FinderSettings = FinderSettings()
