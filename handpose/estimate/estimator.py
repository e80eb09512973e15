"""Estimate hands at places in depth frames, and in crops.

    start       a place where a hand may be: a finder's, or a given centre (``predictor``)
    crops       the place is cropped, and the crop is moved to the palm that the network
                predicts in it
    network     predicts a pose in every crop
    fit         moves the pose until it explains the depth (``handpose.fit``)
    selection   between the sides, and between the crops, by the cost of the fit

The network and the capsule model know right hands, so each crop is of the view in which its hand is
one (``SideView``). Many crops are processed together, because the arrays of one are so small that
most of the time would be overhead.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side, SideView, camera_of
from handpose.estimate.candidates import Candidate, SearchRegion
from handpose.estimate.crop_fits import fit_crops
from handpose.estimate.expected import ExpectedBodies
from handpose.estimate.hand import HandEstimate, in_groups, judge
from handpose.estimate.nets import network_joints, the_hand_layer
from handpose.estimate.palm import recenter
from handpose.fit.body import CapsuleModel, crop_variables
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.observation import HandCrops
from handpose.fit.pose_confidence import Judge
from handpose.fit.settings import FitSettings, Plan
from handpose.frames.cameras import Camera, Floats
from handpose.frames.crops import clear_crop, picked
from netlib.blob import Array
from netlib.errors import DataError
from netlib.net import Net


class HandEstimator:
    """Estimates the hands at places in frames, and in crops.

    net      with the input blob depth and a HandModel
    cube_mm  edge of the crops' cubes
    sides    of the hands that are assumed at every place
    refine   maximum number of moves of a crop to the palm predicted in it
    fitter   of the net's body; None leaves the joints to the network
    plan     of the fit; None without a fitter
    settings  tuned numbers; with a fitter its own

    Has further

    skeleton  of the net's body
    judge     of the hands, by the settings
    """

    def __init__(
        self,
        net: Net,
        cube_mm: float,
        sides: tuple[Side, ...] = ("right",),
        refine: int = 0,
        fitter: DepthFitter | None = None,
        plan: Plan | None = None,
        settings: FitSettings = FitSettings(),
    ) -> None:
        self.net, self.cube_mm, self.sides = net, cube_mm, sides
        self.skeleton = the_hand_layer(net).skeleton
        self.refine, self.fitter, self.plan = refine, fitter, plan
        self.settings = fitter.settings if fitter else settings
        self.judge = Judge(self.settings)

    @cached_property
    def expected(self) -> ExpectedBodies:
        """The bodies that are expected from earlier frames; an error without a fitter."""
        return ExpectedBodies(self.the_fitter.model, self.cube_mm, self.settings)

    @property
    def the_fitter(self) -> DepthFitter:
        """The fitter; an error without one."""
        assert self.fitter is not None, "an estimator without a fitter"
        return self.fitter

    # -------------------------------------------------------------------------------------- a hand

    def in_crop(self, crop: NDArray[np.float32], camera: Camera, center_uvd: Array) -> HandEstimate:
        """The hand in one crop (128, 128), of the side whose fit costs less.

        Raises NetlibError.
        """
        candidates = [Candidate.of_side(side, crop, center_uvd, camera) for side in self.sides]
        return _likelier(self.estimate(candidates, camera, self.plan))

    def in_frame(self, frame: SideView, place: Array, *, is_middle: bool = False) -> HandEstimate:
        """The hand at a place (3,) in a frame, px, px, mm in its view.

        is_middle  the place is the middle of the joints, not that of a crop. Then the crop about it
                   competes with that about the palm, because some hands are lost on the way

        Raises DataError for a place outside the image, or if the hand is predicted behind the
        camera; NetlibError.
        """
        hand = self._select(self._candidates(frame, place, is_middle), frame)
        if not (hand.xyz[:, 2] > 0).all():
            raise DataError(
                f"a pose is predicted in which a joint is at a depth of {hand.xyz[:, 2].min():.0f} mm, "
                "behind the camera"
            )
        return hand

    def palm_at(self, view: SideView, start: Array) -> Array:
        """The crop centre (3,) that the network gives from a start in a view, px, px, mm; the start
        outside the image.
        """
        try:
            most = self.settings.crops.max_move_mm
            return self._moved_to_palm(view, self._candidate(view, start), most).center_uvd
        except DataError:
            return start

    def _candidate(self, view: SideView, place: Array) -> Candidate:
        """The crop about a place. Raises DataError outside the image."""
        crop = clear_crop(view.depth, place, self.cube_mm, view.camera)
        return Candidate(place, view.side, crop=crop, weight=self._weight(view, place))

    def _weight(self, view: SideView, place: Array) -> Floats | None:
        """The weights of the pixels of a crop."""
        if view.weight is None:
            return None
        return picked(view.weight, place, self.cube_mm, view.camera)

    def _candidates(self, frame: SideView, place: Array, is_middle: bool) -> list[Candidate]:
        """The crops about the palms that are predicted from a place, once for each side."""
        candidates: list[Candidate] = []
        crops = self.settings.crops
        most = crops.from_middle_mm if is_middle else crops.max_move_mm
        for side in self.sides:
            view = frame.of(side)
            unmoved = self._candidate(view, frame.pixel_in(side, place))
            moved = self._moved_to_palm(view, unmoved, most)
            both = is_middle and self.plan is not None and moved is not unmoved
            candidates += [unmoved, moved] if both else [moved]
        return candidates

    def _moved_to_palm(self, view: SideView, candidate: Candidate, most: float) -> Candidate:
        """The candidate with its crop centred on the palm that is predicted in it, at most ``most``
        mm from its start; unchanged if the crop is already there.
        """
        start = candidate.center_uvd
        camera = view.camera
        for _ in range(self.refine):
            joints = network_joints(self.net, candidate.crop)
            palm = recenter(joints, self.skeleton, candidate.center_uvd, self.cube_mm, camera)
            if np.array_equal(palm, candidate.center_uvd):
                break
            distance = np.linalg.norm(camera.unproject(palm) - camera.unproject(start))
            if not (distance < most and palm[2] > self.cube_mm / 2):
                break
            try:
                candidate = self._candidate(view, palm)
            except DataError:  # outside the image
                break
        return candidate

    def _select(self, candidates: list[Candidate], frame: SideView) -> HandEstimate:
        """The hand of the crop whose fast fit costs least, fitted by the plan as either side."""
        camera = camera_of(frame.camera, frame.side)
        if self.plan is None or len(candidates) == 1:
            return self.estimate(candidates[:1], camera, self.plan, frame)[0]
        plan = self.settings.search.fast
        fast = list(zip(self.estimate(candidates, camera, plan, frame), candidates))
        best = min(fast, key=lambda found: found[0].cost)[1]
        hands = {_key(candidate): hand for hand, candidate in fast} if self.plan == plan else {}
        view = frame.of(best.side)
        sides = [
            best
            if side == best.side
            else self._candidate(frame.of(side), view.pixel_in(side, best.center_uvd))
            for side in self.sides
        ]
        unfitted = [candidate for candidate in sides if _key(candidate) not in hands]
        hands |= zip(map(_key, unfitted), self.estimate(unfitted, camera, self.plan, frame))
        return _likelier([hands[_key(candidate)] for candidate in sides])

    # ---------------------------------------------------------------------------- hands together

    def in_regions(
        self, frame: SideView, regions: Sequence[SearchRegion], plan: Plan | None = None
    ) -> list[HandEstimate | None]:
        """The hand in each region of a frame; None if it is outside the image. Raises NetlibError.

        What is in front of a region's cube and of the expected body hides a part of it.

        plan  of the fit; by default the estimator's
        """
        candidates: dict[int, Candidate] = {}
        for i, region in enumerate(regions):
            with contextlib.suppress(DataError):  # outside the image
                candidates[i] = self._in_region(frame.of(region.side), region)
        camera = camera_of(frame.camera, frame.side)
        hands = self.estimate(list(candidates.values()), camera, plan or self.plan, frame)
        found = dict(zip(candidates, hands))
        return [found.get(i) for i in range(len(regions))]

    def _in_region(self, view: SideView, region: SearchRegion) -> Candidate:
        """A region of a view with its crop. Raises DataError outside the image."""
        place = region.center_uvd
        before = region.before
        shown = clear_crop(view.depth, place, self.cube_mm, view.camera)
        weight = self._weight(view, place)
        if before is None:
            return Candidate(**vars(region), crop=shown, weight=weight)
        crop = self.expected.with_unknown(shown, view, place, before)
        other = None if crop is shown else shown
        return Candidate(**vars(region), crop=crop, shown=other, weight=weight)

    def estimate(
        self,
        candidates: Sequence[Candidate],
        camera: Camera,
        plan: Plan | None,
        view: SideView | None = None,
    ) -> list[HandEstimate]:
        """The hands in crops of one camera's frames, judged if the network's errors are known.

        Raises NetlibError.

        plan  of the fit; None: by the network alone
        view  the frame of all crops, which judges the poses; None: each crop alone
        """
        if plan is None or self.fitter is None:
            return [self._predicted(candidate, camera) for candidate in candidates]
        fitter = self.fitter

        def fitted(alike: Sequence[Candidate]) -> list[HandEstimate]:
            return self._fitted(alike, camera, fitter, plan)

        hands = in_groups(candidates, lambda one: (one.size is not None, one.asks_network), fitted)
        return judge(hands, view, self.judge) if fitter.errors.is_measured else hands

    def _predicted(self, candidate: Candidate, camera: Camera) -> HandEstimate:
        """The hand by the network alone."""
        joints = network_joints(self.net, candidate.crop) * (self.cube_mm / 2)
        place = candidate.center_uvd
        return HandEstimate(candidate.side, candidate.crop, place, self.cube_mm, camera, joints)

    def _fitted(
        self, candidates: Sequence[Candidate], camera: Camera, fitter: DepthFitter, plan: Plan
    ) -> list[HandEstimate]:
        """The hands in crops of which all or none have a size, and all or none run the network."""
        hands = self._crops(candidates, camera)
        first = candidates[0]
        known = np.array([candidate.before is not None for candidate in candidates])
        sizes = (
            None if first.size is None else np.array([candidate.size for candidate in candidates])
        )
        before = self._expected(candidates, camera, fitter.model) if known.any() else None
        if before is not None and not first.asks_network:
            fit = fitter.follow(fitter.observe(hands, plan), before, plan, size=sizes)
            is_tracked = known
        else:
            fit = fit_crops(self.net, fitter, hands, plan, size=sizes, before=before)
            is_tracked = known & (fit.start == len(plan.quarters))
        fits = [fit.take(slice(n, n + 1)) for n in range(len(candidates))]
        return [
            HandEstimate(
                one.side,
                one.crop,
                one.center_uvd,
                self.cube_mm,
                camera,
                own.network[0],
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
                center = camera_of(camera, candidate.side).unproject(candidate.center_uvd)
                x[n] = crop_variables(model, candidate.before, center)
        return np.clip(x, model.lower, model.upper)

    def _crops(self, candidates: Sequence[Candidate], camera: Camera) -> HandCrops:
        shown = weight = None
        if any(one.shown is not None for one in candidates):
            shown = np.stack([one.crop if one.shown is None else one.shown for one in candidates])
        if any(one.weight is not None for one in candidates):
            weight = np.stack([_weight_of(one) for one in candidates])
        crops = np.stack([one.crop for one in candidates])
        center_uvd = np.stack([one.center_uvd for one in candidates])
        cameras = [camera_of(camera, one.side) for one in candidates]
        return HandCrops(crops, center_uvd, cameras, self.cube_mm, shown, weight)


def _weight_of(candidate: Candidate) -> Floats:
    """The weights of a candidate's pixels; 1 without any."""
    return np.ones_like(candidate.crop) if candidate.weight is None else candidate.weight


def _key(candidate: Candidate) -> tuple[object, ...]:
    """The key of a crop within a frame: centre and side."""
    return (*candidate.center_uvd, candidate.side)


def _likelier(sides: Sequence[HandEstimate]) -> HandEstimate:
    """The hand of one crop whose fit costs less, with the other side's, if any, as ``other``.

    The cost of an accurate fit finds the right side in 99% of 384 synthetic frames, and in 93% of
    920 real ones (docs/fit.md), of those of P3 in 88%; the expected error in 80% of these.
    """
    best, *others = sorted(sides, key=lambda hand: hand.cost)
    return replace(best, other=others[0]) if others else best
