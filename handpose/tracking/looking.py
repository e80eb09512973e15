"""One look at places of a depth image: what the network sees there, and what the fit makes of it.

Places of several hands are looked at together: the arrays of one are so small that most of the time is spent between
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import crop
from handpose.facts.cameras import Camera
from handpose.fitting.depth.body import SIZE
from handpose.fitting.depth.fit import DepthFit
from handpose.fitting.depth.observation import Observation, joined, observe
from handpose.fitting.depth.search import PLANS
from handpose.fitting.depth.strangeness import strangeness
from handpose.predicting.finding import recenter
from handpose.predicting.nets import hand_inputs
from handpose.predicting.predictor import Predictor
from handpose.tracking.body_pose import Placed, Placer
from handpose.tracks.track import MIRROR
from netlib.blob import Array
from netlib.errors import DataError


class Aim(NamedTuple):
    """Where to look, and as what.

    center_uvd  (3,) px, px, mm: the middle of the crop
    side        the hand that it is to be seen as
    before      the body as the frames before let it be expected, if there are any
    size        of the hand, if it is known
    """

    center_uvd: Array
    side: str
    before: Placed | None = None
    size: float | None = None


class Sight(NamedTuple):
    """What was seen.

    aim         where
    center_mm   (3,) of the crop, in the space of the body: of a left hand, mirrored
    crop        (128, 128) in [-1, 1], not mirrored
    seen        what the fit knows of the crop
    fit         of this body alone
    body        in space
    """

    aim: Aim
    center_mm: Array
    crop: NDArray[np.float32]
    seen: Observation
    fit: DepthFit
    body: Placed

    @property
    def doubt(self) -> float:
        """How much speaks against the fit."""
        return float(self.fit.doubt[0])

    @property
    def badness(self) -> float:
        """What compares looks by different plans: the expected error in mm; where it is not known, the misfit."""
        return float(np.nan_to_num(self.fit.error_mm[0], nan=self.fit.misfit[0]))

    @property
    def confidence(self) -> float:
        """The chance that the error of the joints is below 30 mm; where nobody has measured it, 1 or 0."""
        known = float(self.fit.confidence[0])
        return known if np.isfinite(known) else float(np.isfinite(self.doubt))


class Looker:
    """Looks at places with the network and the fitter of a predictor, by its plan."""

    def __init__(self, predictor: Predictor, camera: Camera) -> None:
        assert predictor.fitter is not None
        self.net, self.fitter, self.camera = predictor.net, predictor.fitter, camera
        self.cube_mm, self.plan = predictor.cube_mm, predictor.fit
        self.placer = Placer(self.fitter.model)
        self._middle = self._middle_of_crops()

    def look(self, depth: NDArray[np.float32], aims: Sequence[Aim], plan: str | None = None) -> list[Sight | None]:
        """What is seen at each place; None where it is out of sight. Raises NetlibError.

        plan  of the fit; by default the predictor's
        """
        found: list[Sight | None] = [None] * len(aims)
        crops = {}
        for i, aim in enumerate(aims):
            try:
                crops[i] = crop(depth, aim.center_uvd, self.cube_mm, self.camera)
            except DataError:
                continue
        for known in (True, False):
            for follows in (True, False):
                own = [i for i in crops if (aims[i].size is not None, aims[i].before is not None) == (known, follows)]
                if own:
                    sights = self._look([aims[i] for i in own], np.stack([crops[i] for i in own]), plan or self.plan)
                    for i, sight in zip(own, sights):
                        found[i] = sight
        return found

    def center_of(self, body: Placed, side: str) -> Array:
        """Where a crop of a body has its centre (3,), px, px, mm."""
        center = body.place + body.rotation @ self._middle
        return self.camera.project(center * MIRROR if side == "left" else center)

    def palm_seen(self, sight: Sight) -> Array:
        """Where the network alone would have the crop's centre (3,), px, px, mm."""
        side = sight.aim.side
        joints = sight.fit.network[0] * (MIRROR if side == "left" else 1.0) / (self.cube_mm / 2)
        return recenter(joints, self.fitter.model.skeleton, sight.aim.center_uvd, self.cube_mm, self.camera,
                        side == "left")  # fmt: skip

    def strangeness(self, sight: Sight) -> float:
        """How little there is a hand, in mm."""
        camera, uvd, seen = self.camera, sight.aim.center_uvd, sight.crop
        if sight.aim.side == "left":
            camera = mirrored_camera(camera)
            uvd, seen = np.array([self.camera.width - 1 - uvd[0], *uvd[1:]]), seen[:, ::-1]
        return float(strangeness(self.fitter.model, sight.fit, seen[None], uvd[None], camera)[0])

    def _middle_of_crops(self) -> Array:
        """Where a crop has its centre (3,) in mm, from the root's place and along its axes."""
        model, far = self.fitter.model, np.array([0.0, 0.0, 1000.0])
        x = np.zeros((1, model.variables))
        root = self.placer.placed(x[0], far)
        uvd = self.camera.project(far)
        center = recenter(model.joints(x)[0] / (self.cube_mm / 2), model.skeleton, uvd, self.cube_mm, self.camera)
        return np.asarray(root.rotation.T @ (self.camera.unproject(center) - root.place))

    def _look(self, aims: Sequence[Aim], crops: NDArray[np.float32], plan: str) -> list[Sight]:
        """The same for places that are all followed, or none, and all of known size, or none."""
        how, left = PLANS[plan], np.array([aim.side == "left" for aim in aims])
        shown = crops.copy()
        shown[left] = crops[left][:, :, ::-1]
        turned = np.concatenate([np.rot90(shown, quarter, (1, 2)) for quarter in how.quarters])
        predictions = np.split(hand_inputs(self.net, turned), len(how.quarters))
        uvd = np.stack([aim.center_uvd for aim in aims])
        seen = observe(crops, uvd, self.camera, self.cube_mm, how.points)
        seen = joined([
            seen.cut(i).mirrored() if mirrored else seen.cut(i) for i, mirrored in enumerate(left)
        ]) if left.any() else seen  # fmt: skip
        centers = self.camera.unproject(uvd) * np.where(left[:, None], MIRROR, 1.0)
        before = sizes = None
        if aims[0].before is not None:
            before = np.stack([
                self.placer.variables(aim.before, center) for aim, center in zip(aims, centers) if aim.before
            ])  # fmt: skip
        if aims[0].size is not None:
            sizes = np.array([aim.size for aim in aims])
        fit = self.fitter.fit(seen, predictions, plan, size=sizes, before=before)
        return [
            Sight(aim, center, crops[i], seen.cut(i), alone, self.placer.placed(alone.x[0], center))
            for i, (aim, center) in enumerate(zip(aims, centers))
            for alone in [one_of(fit, i)]
        ]


def one_of(fit: DepthFit, row: int) -> DepthFit:
    """The fit of one of several bodies."""
    return DepthFit(**{name: values[row : row + 1] for name, values in vars(fit).items()})


def mirrored_camera(camera: Camera) -> Camera:
    """The camera that sees what a mirror shows."""
    return Camera(camera.name, camera.fx, camera.fy, camera.width - 1 - camera.u0, camera.v0, camera.width,
                  camera.height)  # fmt: skip


def size_of(sight: Sight) -> float:
    """Of the hand, relative to the skeleton."""
    return float(np.exp(sight.fit.x[0, SIZE]))
