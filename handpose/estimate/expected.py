"""A body that is expected from earlier frames: where it is, and what a crop shows of it."""

from __future__ import annotations

import cv2
import numpy as np

from handpose.body.capsules import Capsules
from handpose.body.render import shown_in_crop
from handpose.body.sides import SideView
from handpose.estimate.palm import recenter
from handpose.fit.body import CapsuleModel, WorldPose, crop_variables, world_pose
from handpose.fit.settings import FitSettings
from handpose.fit.support import ImageSupport
from handpose.frames.cameras import NYU, Camera, Floats
from handpose.frames.crops import BACKGROUND, SIZE, unread, with_hidden
from netlib.blob import Array


class ExpectedBodies:
    """Bodies of a model, in crops with cubes of edge ``cube_mm``.

    support  compares them with images
    """

    def __init__(self, model: CapsuleModel, cube_mm: float, settings: FitSettings) -> None:
        self.model = model
        self.cube_mm = cube_mm
        self.settings = settings.expected
        self.support = ImageSupport(settings.support)
        reach = 2 * round(self.settings.around_mm * SIZE / cube_mm) + 1
        self._around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        self._middle = self._middle_of_crops()

    def capsules(self, pose: WorldPose) -> Capsules:
        """The surface of a body in its view."""
        x = crop_variables(self.model, pose, pose.place)[None]
        return self.model.capsules(x, pose.place[None])

    def joints(self, pose: WorldPose) -> Array:
        """The joints (K, 3) of a body in mm, in its view."""
        x = crop_variables(self.model, pose, pose.place)[None]
        return self.model.joints(x)[0] + pose.place

    def center_of(self, pose: WorldPose, camera: Camera) -> Array:
        """The crop centre (3,) of a body, px, px, mm of the camera of its view."""
        return camera.project(pose.place + pose.rotation @ self._middle)

    def with_unknown(self, shown: Floats, view: SideView, uvd: Array, pose: WorldPose) -> Floats:
        """A crop of a view about a place (3,) with the pixels at the near face that do not show
        what an expected body has there.

        These have readings of something in front of it, or none although the body was read.
        """
        limbs, readings, camera = self.model.surface.limbs, view.readings, view.camera
        body = self.capsules(pose)
        s = self.settings
        image = np.asarray(readings, np.float32)
        crop = shown
        seen = self.support.support(body, limbs, image, camera)
        if seen.hidden[0] >= s.hiding:
            crop = with_hidden(crop, readings, uvd, self.cube_mm, camera)
        missing = seen.missing[0] >= s.unread and seen.outside[0] < s.leaving
        if missing and self._explained(shown, body, uvd, camera) >= s.explained:
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
        on = seen & (apart <= self.support.settings.tolerance_mm / (self.cube_mm / 2))
        return float(on.sum() / max(seen.sum(), 1))

    def _rendered(self, capsules: Capsules, center_uvd: Array, camera: Camera) -> Floats:
        """What a crop (S, S) about a centre (3,) would show of capsules; 1 without a surface."""
        return shown_in_crop(capsules, center_uvd, self.cube_mm, camera)

    def _middle_of_crops(self) -> Array:
        """The crop centre (3,) in mm, from the root's position and in its axes."""
        model = self.model
        far = np.array([0.0, 0.0, 1000.0])
        x = np.zeros((1, model.variables))
        root = world_pose(model, x[0], far)
        joints = model.joints(x)[0] / (self.cube_mm / 2)
        center = recenter(joints, model.skeleton, NYU.project(far), self.cube_mm, NYU)
        return root.rotation.T @ (NYU.unproject(center) - root.place)
