"""Predict and fit hands in search regions of a depth image.

The regions of several hands are processed together, because the arrays of one hand are so small
that most of the time would be overhead.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import cv2
import numpy as np

from handpose.body.render import Capsules, in_front, normalise_depth, render_crop
from handpose.body.sides import Side, mirror_of
from handpose.estimate.estimator import Candidate, SearchRegion
from handpose.estimate.hand import Hand
from handpose.estimate.pipeline import recenter
from handpose.estimate.predictor import Predictor
from handpose.fit.body import WorldPose, crop_variables, world_pose
from handpose.fit.search import Plan
from handpose.fit.support import APART_MM, support
from handpose.frames.cameras import Camera, Floats
from handpose.frames.crops import BACKGROUND, SIZE, clear_crop, unread, with_hidden
from handpose.tracking.reasons import LEAVING, reason
from netlib.blob import Array
from netlib.errors import DataError

ARM_PLACES = 5  # along a forearm
# The minimum share of an expected surface without a reading, and the minimum share of the crop's
# readings that it explains: otherwise the hand itself has moved. In the ordinary frames of CVAR's
# P1, P3, P4, P7 and of hpx the first is below 0.06 in 99% and at most 0.15, though 75% of a crop
# are background without readings. The second was chosen on frames of P1, P4 and P6 of which a
# part was not read.
UNREAD, EXPLAINED = 0.15, 0.5
AROUND_MM = 15.0  # pixels without a reading this close to it may be of it
# minimum share of the expected surface behind nearer readings: fewer are reflections,
# mostly next to it
HIDING = 0.08


class PoseEstimator:
    """Predicts and fits hands with the network, the fitter and the plan of a predictor."""

    def __init__(self, predictor: Predictor, camera: Camera) -> None:
        assert predictor.fitter is not None and predictor.plan is not None
        self.fitter, self.model, self.camera = predictor.fitter, predictor.fitter.model, camera
        self.cube_mm, self.plan, self.sides = predictor.cube_mm, predictor.plan, predictor.sides
        self._pipeline = predictor.pipeline
        self._middle = self._middle_of_crops()
        reach = 2 * round(AROUND_MM * SIZE / self.cube_mm) + 1
        self._around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))

    def estimate(
        self,
        depth: Floats,
        regions: Sequence[SearchRegion],
        plan: Plan | None = None,
        readings: Floats | None = None,
    ) -> list[Hand | None]:
        """The hand in each region; None if it is outside the image. Raises NetlibError.

        plan      of the fit; by default the predictor's
        readings  the image with those readings that are nearer than the camera measures: what is in
                  front of a region's cube and of the expected body hides a part of it. By default
                  it is background
        """
        candidates: dict[int, Candidate] = {}
        for i, region in enumerate(regions):
            with contextlib.suppress(DataError):  # outside the image
                candidates[i] = self._candidate(depth, region, readings)
        judging = depth if readings is None else readings
        hands = self._pipeline.estimator.estimate(
            list(candidates.values()), self.camera, plan or self.plan, judging
        )
        found = dict(zip(candidates, hands))
        return [found.get(i) for i in range(len(regions))]

    def _candidate(self, depth: Floats, region: SearchRegion, readings: Floats | None) -> Candidate:
        """A region with its crop. Raises DataError outside the image."""
        shown = clear_crop(depth, region.center_uvd, self.cube_mm, self.camera)
        if readings is None or region.before is None:
            return Candidate(**vars(region), crop=shown)
        crop = self._with_unknown(
            shown, readings, region, self._capsules(region.before, region.side)
        )
        return Candidate(**vars(region), crop=crop, shown=None if crop is shown else shown)

    def _with_unknown(
        self, shown: Floats, readings: Floats, region: SearchRegion, body: Capsules
    ) -> Floats:
        """A region's crop with the pixels at the near face that do not show what an expected
        body has there.

        These have readings of something in front of it, or none although the body was read.
        """
        limbs, uvd, crop = self.model.surface.limbs, region.center_uvd, shown
        seen = support(body, limbs, readings, self.camera)
        if seen.hidden[0] >= HIDING:
            crop = with_hidden(crop, readings, uvd, self.cube_mm, self.camera)
        missing = seen.missing[0] >= UNREAD and seen.outside[0] < LEAVING
        if missing and self._explained(shown, body, uvd) >= EXPLAINED:
            own = self._rendered(body.chosen(~limbs), uvd) < 1
            around = cv2.dilate(own.astype(np.uint8), self._around) > 0
            crop = np.where(
                around & unread(readings, uvd, self.cube_mm, self.camera), np.float32(-1), crop
            )
        return crop

    def _explained(self, crop: Floats, body: Capsules, center_uvd: Array) -> float:
        """The share of a crop's readings that are on the surface of an expected body;
        0 without any.
        """
        seen = crop < BACKGROUND
        on = seen & (
            np.abs(crop - self._rendered(body, center_uvd)) <= APART_MM / (self.cube_mm / 2)
        )
        return float(on.sum() / max(seen.sum(), 1))

    def _rendered(self, capsules: Capsules, center_uvd: Array) -> Floats:
        """What a crop (S, S) about a centre (3,) would show of capsules; 1 without a surface."""
        d, cube = center_uvd[2:], self.cube_mm
        image = render_crop(in_front(capsules, d - cube / 2), center_uvd[None], cube, self.camera)
        return normalise_depth(image, d, cube)[0]

    def center_of(self, body: WorldPose, side: Side) -> Array:
        """The crop centre (3,) of a body, px, px, mm."""
        center = body.place + body.rotation @ self._middle
        return self.camera.project(center * mirror_of(side))

    def reason(self, depth: Floats, body: WorldPose, side: Side, confidence: float) -> str:
        """The reason why a hand that was expected as this body is not in an image, with
        all readings, mm.

        confidence  of the best pose found there
        """
        joints = self.model.joints(crop_variables(self.model, body, body.place)[None])[0]
        seen = support(self._capsules(body, side), self.model.surface.limbs, depth, self.camera)
        xyz, center = (joints + body.place) * mirror_of(side), self.center_of(body, side)
        return reason(depth, self.camera, xyz, center, self.cube_mm, seen, confidence)

    def _capsules(self, body: WorldPose, side: Side) -> Capsules:
        """The surface of a body in camera axes."""
        x = crop_variables(self.model, body, body.place)[None]
        return self.model.capsules(x, body.place[None]).mirrored(mirror_of(side))

    def palm_at(self, depth: Floats, start: Array, side: Side) -> Array:
        """The crop centre (3,) that the network gives from a start, px, px, mm; the start
        outside the image.
        """
        try:
            return self._pipeline.palm_at(depth, self.camera, start, side)
        except DataError:
            return start

    def arm(self, hand: Hand) -> Array:
        """Positions (A, 3) in mm, camera axes, along the capsules of the surface alone: the
        forearm of a hand.
        """
        capsules, limbs = hand.capsules(in_space=True), self.model.surface.limbs
        a, b = capsules.a[0, limbs], capsules.b[0, limbs]
        places = a[:, None] + np.linspace(0, 1, ARM_PLACES)[:, None] * (b - a)[:, None]
        return np.asarray(places.reshape(-1, 3))

    def _middle_of_crops(self) -> Array:
        """The crop centre (3,) in mm, from the root's position and in its axes."""
        model, far = self.model, np.array([0.0, 0.0, 1000.0])
        x = np.zeros((1, model.variables))
        root = world_pose(model, x[0], far)
        uvd = self.camera.project(far)
        center = recenter(
            model.joints(x)[0] / (self.cube_mm / 2), model.skeleton, uvd, self.cube_mm, self.camera
        )
        return np.asarray(root.rotation.T @ (self.camera.unproject(center) - root.place))
