"""Fit the capsule model of a body to depth crops, started from a network's prediction.

The fit halves the error of the network. What remains is judged by the image: ``pose_confidence``.

fitter = DepthFitter(CapsuleModel(skeleton, CUBE_MM / 2), errors)
plan = fitter.settings.search.accurate
seen = fitter.observe(HandCrops(crops, center_uvd, camera, CUBE_MM), plan)
# starts: the network's predictions, one per quarter turn of the plan
found = fitter.fit(seen, starts, plan)
found.joints  # (N, K, 3) mm from the crops' centres
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel
from handpose.fit.network_errors import NetworkErrors, read_errors, unknown_errors
from handpose.fit.objective import Objective
from handpose.fit.observation import HandCrops, Observation, observe
from handpose.fit.rounding import NETWORK_STEP, rounded
from handpose.fit.search import Search, SearchResult, Starts, drawn
from handpose.fit.settings import FitSettings, Plan
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, blocks
from netlib.engine import for_each
from netlib.errors import DataError
from netlib.files import Content

EMPTY_CROP = 0.01  # share of foreground; in a crop with less, the cost is infinite
STARTS_TOGETHER = 80  # fits per batch, so that their arrays stay in the cache


@dataclass(frozen=True)
class DepthFit:
    """The fits of N frames.

    joints      (N, K, 3) mm from the crops' centres
    network     (N, K, 3) mm, the joints of the first start: the network's, or in ``follow``
                the expected ones
    cost        (N,) sum of all terms; infinite where nothing is visible
    x           (N, V) all variables, for ``CapsuleModel``
    parts       (N, 4) of the cost: surface, outline, front, prior; infinite where nothing is
                visible. All points count alike in them: a finder may take something else for a
                hand, which then fits its own points well
    start       (N,) index of its start: first the quarter turns, then the expected pose,
                then those drawn
    """

    joints: Array
    network: Array
    cost: Array
    x: Array
    parts: Array
    start: Array

    def __len__(self) -> int:
        return len(self.x)

    def take(self, rows: slice) -> DepthFit:
        """The fits of some frames."""
        return DepthFit(**{name: values[rows] for name, values in vars(self).items()})

    @classmethod
    def concatenate(cls, parts: Sequence[DepthFit]) -> DepthFit:
        """The fits of the frames of all parts, in order."""
        return cls(
            **{
                name: np.concatenate([getattr(part, name) for part in parts])
                for name in vars(parts[0])
            }
        )


class DepthFitter:
    """Fits one body.

    errors    of the network that predicts the starts; by default those of an unknown network
    seed      of the drawn starts
    settings  tuned numbers
    """

    def __init__(
        self,
        model: CapsuleModel,
        errors: NetworkErrors | None = None,
        seed: int = 0,
        settings: FitSettings = FitSettings(),
    ) -> None:
        self.model, self.seed, self.settings = model, seed, settings
        self.errors = errors or unknown_errors(self.model)
        self.objective = Objective(self.model, settings.objective, self.errors.poses)
        self.search = Search(settings.search)
        self.precision = np.linalg.inv(self.errors.limbs)

    @classmethod
    def of_file(
        cls,
        skeleton: Skeleton,
        path: str | Path | Content,
        unit_mm: float,
        seed: int = 0,
        settings: FitSettings = FitSettings(),
    ) -> DepthFitter:
        """A fitter for crops of two such units, with the network's errors of a weights file.

        Raises DataError.
        """
        model = CapsuleModel(skeleton, unit_mm)
        return cls(model, read_errors(path, model), seed, settings)

    def observe(self, hands: HandCrops, plan: Plan) -> Observation:
        """Crops as observations for a plan. Raises DataError."""
        return observe(hands, plan.points, self.settings.thin_px)

    def fit(
        self,
        seen: Observation,
        starts: Sequence[Array],
        plan: Plan,
        *,
        size: float | Array | None = None,
        before: Array | None = None,
    ) -> DepthFit:
        """Fit every frame and return the best fits. Raises DataError.

        The same frames give bitwise equal fits, whatever other frames are fitted with them and on
        any processor, with rare exceptions (docs/reliability.md, "What repeats exactly").

        starts  x (N, V) predicted in the crops, one array for each quarter turn of the plan
        size    of the body, one or (N,), if it is known
        before  x (N, V) expected from earlier frames: one more start, with a prior about
                itself; NaN without
        """
        model = self.model
        if len(starts) != len(plan.quarters):
            raise DataError(
                f"{len(starts)} starts, expected {len(plan.quarters)} for the plan {plan.name!r}"
            )
        predicted = np.stack([rounded(x, NETWORK_STEP) for x in starts])
        if predicted.shape[1] != len(seen):
            raise DataError(f"starts of {predicted.shape[1]} frames for {len(seen)} crops")
        first = predicted[0]
        groups = [_alike(predicted, predicted)]
        if before is not None:
            unknown = np.isnan(before[:, :1])
            x = np.where(unknown, first, before)
            expected = np.where(unknown, first, self._expected(before))
            factor = np.where(unknown, np.inf, self.settings.steady.cost_factor).T
            groups.append(Starts(x[None], expected[None], factor))
        if plan.trials is not None:
            draws = plan.trials.draws
            x = drawn(model, first, self.errors.limbs, draws, self.seed)
            groups.append(_alike(x, np.tile(first, (draws, 1, 1))))
        starts_of_all = Starts(*map(np.concatenate, zip(*groups)))
        found = self._searched(seen, starts_of_all, plan, size)
        return self._results(found, seen, model.joints(first))

    def follow(
        self, seen: Observation, before: Array, plan: Plan, *, size: float | Array | None = None
    ) -> DepthFit:
        """Refine x (N, V) expected from earlier frames by a few iterations, without the network.

        Limbs that are hardly visible are held at their expected pose, because they would jitter
        otherwise. The parts of the cost are computed without that, as for any other fit.
        """
        network = self.model.joints(before)
        held = self.settings.steady.limb_precision
        expected = self._expected(before)
        plan = self.search.refining(plan)
        start = _alike(before[None].copy(), expected[None])
        found = self._searched(seen, start, plan, size, held)
        off = (found.x - expected)[:, self.model.limbs]
        squares = ((off @ self.precision) * off).sum(axis=1)
        found.parts[:, 3] -= (held - 1) * self.objective.weights.limbs * squares
        return self._results(found, seen, network)

    def _expected(self, before: Array) -> Array:
        """The prior for x (N, V): about x, but about the means for the thickness and the surface's
        own variables.
        """
        prior = before.copy()
        prior[:, self.model.own] = 0
        prior[:, THICKNESS_INDEX] = 0
        return prior

    def _searched(
        self,
        seen: Observation,
        starts: Starts,
        plan: Plan,
        size: float | Array | None,
        limb_precision: float = 1.0,
    ) -> SearchResult:
        """The best starts, in batches that fit the cache; the size is set in all if it is known.

        limb_precision  relative to that of the network's limbs
        """
        objective = self.objective
        K, N, V = starts.x.shape
        precision = limb_precision * self.precision
        if size is not None:
            starts.x[:, :, SIZE_INDEX] = starts.expected[:, :, SIZE_INDEX] = np.log(size)
            objective = objective.of_known_size()
        found = SearchResult(np.zeros((N, V)), np.zeros((N, 4)), np.zeros(N, int))

        def job(rows: slice) -> None:
            own = Starts(*(values[:, rows] for values in starts))
            part = self.search.best(objective, seen.take(rows), own, precision, plan)
            for whole, values in zip(found, part):
                whole[rows] = values

        for_each(blocks(N, max(STARTS_TOGETHER // K, 1)), job)
        return found

    def _results(self, found: SearchResult, seen: Observation, network: Array) -> DepthFit:
        """The results of fits whose first start has the joints (N, K, 3)."""
        parts = found.parts
        shown = (seen.outside < 0).mean(axis=(1, 2))[seen.frame]
        is_empty = shown < EMPTY_CROP
        parts[is_empty] = np.inf  # an empty crop contradicts no hand
        cost = parts.sum(axis=1)
        weighted = np.flatnonzero(seen.is_weighted & ~is_empty)
        if len(weighted):
            all_alike = seen.take(weighted).unweighted()
            robust = self.settings.search.robust
            parts[weighted, 0] = self.objective.surface_cost(found.x[weighted], all_alike, robust)
        return DepthFit(
            joints=self.model.joints(found.x),
            network=network,
            cost=cost,
            x=found.x,
            parts=parts,
            start=found.start,
        )


def _alike(x: Array, expected: Array) -> Starts:
    """Starts (K, N, V) whose costs are compared as they are."""
    return Starts(x, expected, np.ones(x.shape[:2]))
