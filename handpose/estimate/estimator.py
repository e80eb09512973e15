"""Estimate hands in crops: the network predicts a pose in every crop, and the fit moves it until it
explains the depth.

The network and the capsule model know right hands. A left hand is mirrored once, by ``HandCrops``,
and mirrored back by ``Hand``. Many crops are processed together, because the arrays of one are so
small that most of the time would be overhead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side, as_right, mirror_of
from handpose.estimate.hand import Hand, judge
from handpose.estimate.nets import hand_poses, network_joints
from handpose.fit.body import SIZE, CapsuleModel, WorldPose, crop_variables
from handpose.fit.depth_fit import DepthFit, DepthFitter
from handpose.fit.joint_starts import near_joints
from handpose.fit.observation import HandCrops
from handpose.fit.rounding import NETWORK_STEP, rounded
from handpose.fit.search import Plan, turned_back
from handpose.frames.cameras import Camera
from handpose.frames.crops import mirror_shift
from netlib.blob import Array, blocks
from netlib.net import Net

MAX_CROPS = 128  # number of crops in one pass of the network


@dataclass(frozen=True)
class SearchRegion:
    """A place where a hand may be.

    center_uvd  (3,) px, px, mm: centre of its crop
    side        assumed side of the hand
    before      the body expected from earlier frames, or None
    size        of the hand, if known
    moved_mm    distance of the last fit from the network's joints; None runs the network again
    """

    center_uvd: Array
    side: Side
    before: WorldPose | None = None
    size: float | None = None
    moved_mm: float | None = None


@dataclass(frozen=True, kw_only=True)
class Candidate(SearchRegion):
    """A region and its crop.

    crop        (128, 128) in [-1, 1]
    shown       (128, 128) the crop for the network, if it is another one
    """

    crop: NDArray[np.float32]
    shown: NDArray[np.float32] | None = None


class HandEstimator:
    """Predicts and fits hands in crops.

    net      with the input blob depth and a HandModel
    cube_mm  edge of the crops' cubes
    fitter   of the net's body; None leaves the joints to the network
    """

    def __init__(self, net: Net, cube_mm: float, fitter: DepthFitter | None) -> None:
        self.net, self.cube_mm, self.fitter = net, cube_mm, fitter

    def estimate(
        self,
        candidates: Sequence[Candidate],
        camera: Camera,
        plan: Plan | None,
        readings: NDArray[np.generic] | None = None,
    ) -> list[Hand]:
        """The hands in crops of one camera's frames, judged if the network's errors are known.

        Raises NetlibError.

        plan      of the fit; None: by the network alone
        readings  (height, width) mm, the frame of all crops, which judges the poses; None:
                  each crop alone
        """
        if plan is None or self.fitter is None:
            return [self._predicted(candidate, camera) for candidate in candidates]
        alike: dict[tuple[bool, bool], list[int]] = {}
        for i, candidate in enumerate(candidates):
            alike.setdefault(
                (candidate.size is not None, candidate.moved_mm is not None), []
            ).append(i)
        found: dict[int, Hand] = {}
        for rows in alike.values():
            found |= zip(
                rows, self._fitted([candidates[i] for i in rows], camera, self.fitter, plan)
            )
        hands = [found[i] for i in range(len(candidates))]
        return judge(hands, readings) if self.fitter.errors.is_measured else hands

    def _predicted(self, candidate: Candidate, camera: Camera) -> Hand:
        """The hand by the network alone."""
        side = candidate.side
        joints = network_joints(self.net, as_right(candidate.crop, side))
        if side == "left":
            joints[:, 0] += mirror_shift(candidate.center_uvd, self.cube_mm, camera)
        joints *= (self.cube_mm / 2) * mirror_of(side)
        return Hand(side, candidate.crop, candidate.center_uvd, self.cube_mm, camera, joints)

    def _fitted(
        self, candidates: Sequence[Candidate], camera: Camera, fitter: DepthFitter, plan: Plan
    ) -> list[Hand]:
        """The hands in crops of which all or none have a size, and all or none run the network."""
        hands, first = self._crops(candidates, camera), candidates[0]
        known = np.array([candidate.before is not None for candidate in candidates])
        sizes = (
            None if first.size is None else np.array([candidate.size for candidate in candidates])
        )
        before = self._expected(candidates, camera, fitter.model) if known.any() else None
        if before is not None and first.moved_mm is not None:
            moved = np.array([candidate.moved_mm for candidate in candidates])
            fit = fitter.follow(hands.observe(plan.points), before, moved, plan, size=sizes)
            is_tracked = known
        else:
            fit = fit_crops(self.net, fitter, hands, plan, size=sizes, before=before)
            is_tracked = known & (fit.start == len(plan.quarters))
        fits = [fit.take(slice(n, n + 1)) for n in range(len(candidates))]
        return [
            Hand(
                one.side,
                one.crop,
                one.center_uvd,
                self.cube_mm,
                camera,
                own.network[0] * mirror_of(one.side),
                own,
                fitter.model,
                is_tracked=bool(expected),
            )
            for one, own, expected in zip(candidates, fits, is_tracked)
        ]

    def _expected(
        self, candidates: Sequence[Candidate], camera: Camera, model: CapsuleModel
    ) -> Array:
        """The expected variables (N, V) within their limits; NaN where nothing is expected."""
        x = np.full((len(candidates), model.variables), np.nan)
        for n, candidate in enumerate(candidates):
            if candidate.before is not None:
                center = camera.unproject(candidate.center_uvd) * mirror_of(candidate.side)
                x[n] = crop_variables(model, candidate.before, center)
        return np.clip(x, model.lower, model.upper)

    def _crops(self, candidates: Sequence[Candidate], camera: Camera) -> HandCrops:
        crops, centers = (
            np.stack([c.crop for c in candidates]),
            np.stack([c.center_uvd for c in candidates]),
        )
        hands = HandCrops.of_sides(
            crops, centers, camera, self.cube_mm, [c.side for c in candidates]
        )
        if all(c.shown is None for c in candidates):
            return hands
        return replace(
            hands, shown=np.stack([c.crop if c.shown is None else c.shown for c in candidates])
        )


def fit_crops(
    net: Net,
    fitter: DepthFitter,
    hands: HandCrops,
    plan: Plan,
    *,
    size: float | Array | None = None,
    before: Array | None = None,
) -> DepthFit:
    """Predict the hands in crops and fit them to the depth; results are in mirrored axes
    for left hands.

    Raises NetlibError.

    hands     with cubes of twice the fitter's unit
    size      of the hands relative to the skeleton, one or (N,), if it is known
    before    x (N, V) expected from earlier frames, as for ``DepthFitter.fit``
    """
    found = []
    for rows in blocks(len(hands), MAX_CROPS):
        part = hands.take(rows)
        starts = fit_starts(net, fitter.model, part.as_right, plan.quarters)
        found.append(
            fitter.fit(
                part.observe(plan.points),
                starts,
                plan,
                size=None if size is None else np.broadcast_to(size, len(hands))[rows],
                before=None if before is None else before[rows],
            )
        )
    return DepthFit.concatenate(found)


def fit_starts(
    net: Net, model: CapsuleModel, crops: NDArray[np.floating], quarters: Sequence[int]
) -> list[Array]:
    """The variables (N, V) predicted in crops (N, S, S) of right hands, one array per quarter turn.

    For each of ``quarters`` the crops are turned counter-clockwise by that number of quarter turns,
    and predictions are turned back. Raises NetlibError.
    """
    poses = hand_poses(
        net, np.concatenate([np.rot90(crops, quarter, (1, 2)) for quarter in quarters])
    )
    x = model.variables_of(rounded(poses.inputs, NETWORK_STEP))
    size = rounded(np.log(poses.size), NETWORK_STEP)
    x[:, SIZE] = np.clip(size, model.lower[SIZE], model.upper[SIZE])
    if poses.joints is not None:
        x = near_joints(model, x, rounded(poses.joints, NETWORK_STEP) * model.unit_mm)
    return [
        turned_back(model, rounded(turned, NETWORK_STEP), quarter)
        for turned, quarter in zip(np.split(x, len(quarters)), quarters)
    ]
