"""Predict and fit hands in search regions of a depth image.

The regions of several hands are processed together, because the arrays of one hand are so small that most of the time
would be overhead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side, mirror_of
from handpose.estimate.crop_fits import fit_starts
from handpose.estimate.locator import recenter
from handpose.estimate.predictor import Predictor
from handpose.fit.depth_fit import DepthFit
from handpose.fit.observation import HandCrops
from handpose.fit.rejection import rejection_score
from handpose.fit.search import Plan
from handpose.fit.support import Support, support
from handpose.frames.cameras import Camera
from handpose.frames.crops import clear_crop
from handpose.tracking.body_pose import PoseConverter, WorldPose
from handpose.tracking.reasons import Expected
from netlib.blob import Array
from netlib.errors import DataError

LIKELY = 0.5  # minimum probability of a hand, by the locator
ARM_PLACES = 5  # along a forearm
TIMES = 2  # number of evaluations of the locator, each at the predicted position


class SearchRegion(NamedTuple):
    """A search region.

    center_uvd  (3,) px, px, mm: centre of the crop
    side        assumed side of the hand
    before      the body expected from earlier frames, or None
    size        of the hand, if known
    moved_mm    last distance of the fit from the network's joints; None runs the network again
    """

    center_uvd: Array
    side: Side
    before: WorldPose | None = None
    size: float | None = None
    moved_mm: float | None = None


class Estimate(NamedTuple):
    """The pose found in a search region.

    region      the search region
    center_mm   (3,) centre of the crop, mirrored for left hands
    crop        (128, 128) in [-1, 1], not mirrored
    fit         of this body alone
    body        in space
    goes_on     True if the fit started from the expected body
    """

    region: SearchRegion
    center_mm: Array
    crop: NDArray[np.float32]
    fit: DepthFit
    body: WorldPose
    goes_on: bool = False

    @property
    def uncertainty(self) -> float:
        """The uncertainty of the fit."""
        return float(self.fit.uncertainty[0])

    @property
    def selection_cost(self) -> float:
        """Compares poses of different plans: the expected error in mm, or the cost if it is unknown."""
        return float(np.nan_to_num(self.error_mm, nan=self.fit.cost[0]))

    @property
    def error_mm(self) -> float:
        """The expected error of the joints; NaN if it was not measured."""
        return float(self.fit.error_mm[0])

    @property
    def confidence(self) -> float:
        """Probability that the error of the joints is below 30 mm; 1 or 0 if it was not measured."""
        known = float(self.fit.confidence[0])
        return known if np.isfinite(known) else float(np.isfinite(self.uncertainty))


class PoseEstimator:
    """Predicts and fits hands with the network, the fitter and the plan of a predictor."""

    def __init__(self, predictor: Predictor, camera: Camera) -> None:
        assert predictor.fitter is not None and predictor.plan is not None
        self.net, self.fitter, self.camera = predictor.net, predictor.fitter, camera
        self.cube_mm, self.plan, self.sides = predictor.cube_mm, predictor.plan, predictor.sides
        assert predictor.locator is not None
        self.locator = predictor.locator
        self.converter = PoseConverter(self.fitter.model)
        self._middle = self._middle_of_crops()

    def estimate(
        self, depth: NDArray[np.float32], regions: Sequence[SearchRegion], plan: Plan | None = None
    ) -> list[Estimate | None]:
        """The pose in each region; None if it is outside the image. Raises NetlibError.

        plan  of the fit; by default the predictor's
        """
        crops: list[NDArray[np.float32] | None] = []
        alike: dict[tuple[bool, bool], list[int]] = {}
        for i, region in enumerate(regions):
            try:
                crops.append(clear_crop(depth, region.center_uvd, self.cube_mm, self.camera))
            except DataError:
                crops.append(None)
                continue
            kind = (region.size is not None, region.moved_mm is not None)
            alike.setdefault(kind, []).append(i)
        found: list[Estimate | None] = [None] * len(regions)
        for own in alike.values():
            shown = np.stack([seen for i in own if (seen := crops[i]) is not None])
            for i, estimate in zip(own, self._estimate([regions[i] for i in own], shown, plan or self.plan)):
                found[i] = estimate
        return found

    def center_of(self, body: WorldPose, side: Side) -> Array:
        """The crop centre (3,) of a body, px, px, mm."""
        center = body.place + body.rotation @ self._middle
        return self.camera.project(center * mirror_of(side))

    def expected(self, depth: NDArray[np.float32], body: WorldPose, side: Side) -> Expected:
        """A body as a hand that is expected in an image, with all readings, mm."""
        center, mirror, model = body.place, mirror_of(side), self.fitter.model
        x = self.converter.variables(body, center)[None]
        capsules = model.capsules(x, center[None]).mirrored(mirror)
        return Expected(
            (model.joints(x)[0] + center) * mirror,
            self.center_of(body, side),
            support(capsules, model.surface.limbs, depth, self.camera),
        )

    def support(self, depth: NDArray[np.float32], estimate: Estimate) -> Support:
        """The support of a pose by an image with all readings, mm."""
        model = self.fitter.model
        capsules = model.capsules(estimate.fit.x, estimate.center_mm[None]).mirrored(mirror_of(estimate.region.side))
        return support(capsules, model.surface.limbs, depth, self.camera)

    def hand_near(self, depth: NDArray[np.float32], estimate: Estimate) -> Array:
        """The crop centre (3,) by the locator, px, px, mm; otherwise by the network, if it was run."""
        middle, side = self.camera.unproject(estimate.region.center_uvd)[None], estimate.region.side
        for _ in range(TIMES):
            chance, middle = self.locator.at(depth, middle, self.camera)
            if not len(chance) or chance[0] < LIKELY:
                break
        else:
            return self.camera.project(middle[0])
        if estimate.region.moved_mm is not None:
            return estimate.region.center_uvd
        joints = estimate.fit.network[0] / (self.cube_mm / 2)
        return recenter(joints, self.fitter.model.skeleton, estimate.region.center_uvd, self.cube_mm, self.camera, side)

    def rejection_score(self, estimate: Estimate) -> float:
        """The rejection score of the fit in mm: how unlike a hand the place is."""
        hand = self._hands([estimate.region], estimate.crop[None])
        known_size = estimate.region.size is not None
        return float(rejection_score(self.fitter.model, estimate.fit, hand, known_size=known_size)[0])

    def arm(self, estimate: Estimate) -> Array:
        """Positions (A, 3) in mm, camera axes, along the capsules of the surface alone: the forearm of a hand."""
        model = self.fitter.model
        capsules, limbs = model.capsules(estimate.fit.x, estimate.center_mm[None]), model.surface.limbs
        a, b = capsules.a[0, limbs], capsules.b[0, limbs]
        places = a[:, None] + np.linspace(0, 1, ARM_PLACES)[:, None] * (b - a)[:, None]
        return np.asarray(places.reshape(-1, 3) * mirror_of(estimate.region.side))

    def _middle_of_crops(self) -> Array:
        """The crop centre (3,) in mm, from the root's position and in its axes."""
        model, far = self.fitter.model, np.array([0.0, 0.0, 1000.0])
        x = np.zeros((1, model.variables))
        root = self.converter.world_pose(x[0], far)
        uvd = self.camera.project(far)
        center = recenter(model.joints(x)[0] / (self.cube_mm / 2), model.skeleton, uvd, self.cube_mm, self.camera)
        return np.asarray(root.rotation.T @ (self.camera.unproject(center) - root.place))

    def _hands(self, regions: Sequence[SearchRegion], crops: NDArray[np.float32]) -> HandCrops:
        """The crops (N, S, S) of these regions."""
        uvd = np.stack([region.center_uvd for region in regions])
        return HandCrops.of_sides(crops, uvd, self.camera, self.cube_mm, [region.side for region in regions])

    def _estimate(self, regions: Sequence[SearchRegion], crops: NDArray[np.float32], plan: Plan) -> list[Estimate]:
        """``estimate`` for regions of which all or none have a size, and all or none run the network."""
        hands = self._hands(regions, crops)
        seen, centers = hands.observe(plan.points), hands.center_mm
        model = self.fitter.model
        known = np.array([region.before is not None for region in regions])
        nothing = np.full(model.variables, np.nan)
        expected = [
            nothing if region.before is None else self.converter.variables(region.before, center)
            for region, center in zip(regions, centers)
        ]
        before = np.clip(np.stack(expected), model.lower, model.upper) if known.any() else None
        sizes = np.array([region.size for region in regions]) if regions[0].size is not None else None
        goes_on = known
        if before is not None and regions[0].moved_mm is not None:
            fit = self.fitter.follow(seen, before, np.array([region.moved_mm for region in regions]), plan, size=sizes)
        else:
            starts = fit_starts(self.net, model, hands.as_right, plan.quarters)
            fit = self.fitter.fit(seen, starts, plan, size=sizes, before=before)
            goes_on = known & (fit.start == len(plan.quarters))
        estimates = []
        for i, (region, center) in enumerate(zip(regions, centers)):
            own = fit.take(slice(i, i + 1))
            estimates.append(
                Estimate(region, center, crops[i], own, self.converter.world_pose(own.x[0], center), bool(goes_on[i]))
            )
        return estimates
