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
from handpose.body.sides import Side, SideView, camera_of, mirror_of
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
        self, frame: SideView, regions: Sequence[SearchRegion], plan: Plan | None = None
    ) -> list[Hand | None]:
        """The hand in each region; None if it is outside the image. Raises NetlibError.

        What is in front of a region's cube and of the expected body hides a part of it.

        plan  of the fit; by default the predictor's
        """
        candidates: dict[int, Candidate] = {}
        for i, region in enumerate(regions):
            with contextlib.suppress(DataError):  # outside the image
                candidates[i] = self._candidate(frame.of(region.side), region)
        hands = self._pipeline.estimator.estimate(
            list(candidates.values()), self.camera, plan or self.plan, frame
        )
        found = dict(zip(candidates, hands))
        return [found.get(i) for i in range(len(regions))]

    def _candidate(self, view: SideView, region: SearchRegion) -> Candidate:
        """A region of a view with its crop. Raises DataError outside the image."""
        shown = clear_crop(view.depth, region.center_uvd, self.cube_mm, view.camera)
        if region.before is None:
            return Candidate(**vars(region), crop=shown)
        crop = self._with_unknown(shown, view, region.center_uvd, self._capsules(region.before))
        return Candidate(**vars(region), crop=crop, shown=None if crop is shown else shown)

    def _with_unknown(self, shown: Floats, view: SideView, uvd: Array, body: Capsules) -> Floats:
        """A crop about a place with the pixels at the near face that do not show what an expected
        body has there.

        These have readings of something in front of it, or none although the body was read.
        """
        limbs, readings, camera = self.model.surface.limbs, view.readings, view.camera
        crop, seen = shown, support(body, limbs, np.asarray(readings, np.float32), camera)
        if seen.hidden[0] >= HIDING:
            crop = with_hidden(crop, readings, uvd, self.cube_mm, camera)
        missing = seen.missing[0] >= UNREAD and seen.outside[0] < LEAVING
        if missing and self._explained(shown, body, uvd, camera) >= EXPLAINED:
            own = self._rendered(body.chosen(~limbs), uvd, camera) < 1
            around = cv2.dilate(own.astype(np.uint8), self._around) > 0
            is_unread = unread(readings, uvd, self.cube_mm, camera)
            crop = np.where(around & is_unread, np.float32(-1), crop)
        return crop

    def _explained(self, crop: Floats, body: Capsules, center_uvd: Array, camera: Camera) -> float:
        """The share of a crop's readings that are on the surface of an expected body;
        0 without any.
        """
        seen = crop < BACKGROUND
        apart = np.abs(crop - self._rendered(body, center_uvd, camera))
        on = seen & (apart <= APART_MM / (self.cube_mm / 2))
        return float(on.sum() / max(seen.sum(), 1))

    def _rendered(self, capsules: Capsules, center_uvd: Array, camera: Camera) -> Floats:
        """What a crop (S, S) about a centre (3,) would show of capsules; 1 without a surface."""
        d, cube = center_uvd[2:], self.cube_mm
        image = render_crop(in_front(capsules, d - cube / 2), center_uvd[None], cube, camera)
        return normalise_depth(image, d, cube)[0]

    def center_of(self, body: WorldPose, side: Side) -> Array:
        """The crop centre (3,) of a body of this side, px, px, mm in its view."""
        camera = camera_of(self.camera, side)
        return camera.project(body.place + body.rotation @ self._middle)

    def reason(self, view: SideView, body: WorldPose, confidence: float) -> str:
        """The reason why a hand that was expected as this body is not in its view of a frame.

        confidence  of the best pose found there
        """
        joints = self.model.joints(crop_variables(self.model, body, body.place)[None])[0]
        readings = np.asarray(view.readings, np.float32)
        seen = support(self._capsules(body), self.model.surface.limbs, readings, view.camera)
        frame = view.of("right")  # as the camera sees it: the reason names its edges
        xyz = (joints + body.place) * mirror_of(view.side)
        center = view.pixel_in("right", self.center_of(body, view.side))
        shown = np.asarray(frame.readings, np.float32)
        return reason(shown, frame.camera, xyz, center, self.cube_mm, seen, confidence)

    def _capsules(self, body: WorldPose) -> Capsules:
        """The surface of a body in its view."""
        x = crop_variables(self.model, body, body.place)[None]
        return self.model.capsules(x, body.place[None])

    def palm_at(self, view: SideView, start: Array) -> Array:
        """The crop centre (3,) that the network gives from a start in a view, px, px, mm; the start
        outside the image.
        """
        try:
            return self._pipeline.palm_at(view, start)
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
