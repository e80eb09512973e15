"""The pipeline from candidates in a depth frame to hands.

    start       a place where a hand may be: a finder's, or a given centre (``predictor``)
    crops       the place is cropped, and the crop is moved to the palm that the network
                predicts in it
    network     predicts a pose in every crop
    fit         moves the pose until it explains the depth (``handpose.fit``)
    selection   between the sides, and between the crops, by the uncertainty of the fit

Network and fit are those of a ``HandEstimator``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import CENTER_IN_PALM
from handpose.body.sides import Side, SideView, camera_of
from handpose.estimate.estimator import Candidate, HandEstimator
from handpose.estimate.hand import Hand
from handpose.estimate.nets import network_joints, the_hand_layer
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.rounding import PLACE_STEP_MM, rounded
from handpose.fit.search import FAST, Plan
from handpose.frames.cameras import Camera
from handpose.frames.crops import clear_crop
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError
from netlib.net import Net

# A crop moves no farther than this from its start, which is in the hand: a prediction farther
# away is wrong.
MAX_MOVE_MM = 60.0


class HandPipeline:
    """Predicts the hands at candidate places.

    net      with the input blob depth and a HandModel
    cube_mm  edge of the crops' cubes
    sides    of the hands that are assumed at every place
    refine   maximum number of moves of a crop to the palm predicted in it
    fitter   of the net's body; None leaves the joints to the network
    plan     of the fit; None without a fitter
    """

    def __init__(
        self,
        net: Net,
        cube_mm: float,
        sides: tuple[Side, ...],
        refine: int,
        fitter: DepthFitter | None,
        plan: Plan | None,
    ) -> None:
        self.net, self.skeleton, self.cube_mm, self.sides = (
            net,
            the_hand_layer(net).skeleton,
            cube_mm,
            sides,
        )
        self.refine, self.plan = refine, plan
        self.estimator = HandEstimator(net, cube_mm, fitter)

    def in_crop(self, crop: NDArray[np.float32], camera: Camera, center_uvd: Array) -> Hand:
        """The hand in one crop (128, 128), of the side whose fit is least uncertain.

        Raises NetlibError.
        """
        candidates = [Candidate.of_side(side, crop, center_uvd, camera) for side in self.sides]
        return _likelier(self.estimator.estimate(candidates, camera, self.plan))

    def in_frame(self, frame: SideView, place: Array, *, unmoved_too: bool = False) -> Hand:
        """The hand at a place (3,) in a frame, px, px, mm in its view.

        unmoved_too  the crop about the place competes with that about the palm, because some hands
                     are lost on the way

        Raises DataError for a place outside the image, or if the hand is predicted behind the
        camera; NetlibError.
        """
        hand = self._select(self._candidates(frame, place, unmoved_too), frame)
        if not (hand.xyz[:, 2] > 0).all():
            raise DataError(
                f"a pose is predicted in which a joint is at a depth of {hand.xyz[:, 2].min():.0f} mm, "
                "behind the camera"
            )
        return hand

    def palm_at(self, view: SideView, start: Array) -> Array:
        """The centre (3,) of the palm that is predicted from a start in a view.

        Raises DataError outside the image.
        """
        return self._moved_to_palm(view, self._candidate(view, start)).center_uvd

    def _candidate(self, view: SideView, place: Array) -> Candidate:
        """The crop about a place. Raises DataError outside the image."""
        crop = clear_crop(view.depth, place, self.cube_mm, view.camera)
        return Candidate(place, view.side, crop=crop)

    def _candidates(self, frame: SideView, place: Array, unmoved_too: bool) -> list[Candidate]:
        """The crops about the palms that are predicted from a place, once for each side."""
        candidates: list[Candidate] = []
        for side in self.sides:
            view = frame.of(side)
            unmoved = self._candidate(view, frame.pixel_in(side, place))
            moved = self._moved_to_palm(view, unmoved)
            both = unmoved_too and self.plan is not None and moved is not unmoved
            candidates += [unmoved, moved] if both else [moved]
        return candidates

    def _moved_to_palm(self, view: SideView, candidate: Candidate) -> Candidate:
        """The crop moved to the palm that is predicted in it; the unchanged candidate if it is
        already there.
        """
        start, camera = candidate.center_uvd, view.camera
        for _ in range(self.refine):
            joints = network_joints(self.net, candidate.crop)
            palm = recenter(joints, self.skeleton, candidate.center_uvd, self.cube_mm, camera)
            if np.array_equal(palm, candidate.center_uvd):
                break
            distance = np.linalg.norm(camera.unproject(palm) - camera.unproject(start))
            if not (distance < MAX_MOVE_MM and palm[2] > self.cube_mm / 2):
                break
            try:
                candidate = self._candidate(view, palm)
            except DataError:  # outside the image
                break
        return candidate

    def _select(self, candidates: list[Candidate], frame: SideView) -> Hand:
        """The hand of the crop whose fast fit is the least uncertain, as either side."""
        camera = camera_of(frame.camera, frame.side)
        if self.plan is None or len(candidates) == 1:
            return self.estimator.estimate(candidates[:1], camera, self.plan, frame)[0]
        fast = list(zip(self.estimator.estimate(candidates, camera, FAST, frame), candidates))
        best = min(fast, key=lambda found: found[0].uncertainty)[1]
        hands = {_key(candidate): hand for hand, candidate in fast} if self.plan is FAST else {}
        view = frame.of(best.side)
        sides = [
            best
            if side == best.side
            else self._candidate(frame.of(side), view.pixel_in(side, best.center_uvd))
            for side in self.sides
        ]
        left = [candidate for candidate in sides if _key(candidate) not in hands]
        hands |= zip(map(_key, left), self.estimator.estimate(left, camera, self.plan, frame))
        return _likelier([hands[_key(candidate)] for candidate in sides])


def _key(candidate: Candidate) -> tuple[object, ...]:
    """The key of a crop within a frame: centre and side."""
    return (*candidate.center_uvd, candidate.side)


def _likelier(sides: Sequence[Hand]) -> Hand:
    """The less uncertain hand of those of one crop, with the other side's, if any, as ``other``.

    On 1,024 synthetic frames the uncertainty of a fast fit finds the right side in 99%, its cost in
    93%. In 200 single real frames that of an accurate fit finds it in 170, the error that is
    expected by the frame in 165.
    """
    best, *others = sorted(sides, key=lambda hand: hand.uncertainty)
    return replace(best, other=others[0]) if others else best


def recenter(
    joints: ArrayLike, skeleton: Skeleton, center_uvd: ArrayLike, cube_mm: float, camera: Camera
) -> Array:
    """The crop centre (3,) for the joints (K, 3) of a right hand that are predicted in the crop at
    ``center_uvd``, in half-cubes from there, as in the training crops.

    For nets trained with NYU's centres; those of other data sets are elsewhere in the palm
    (ICVL's at its joint). Raises DataError if the skeleton has no palm.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(f"skeleton {skeleton.name!r} has no joint 'palm' to move the crop to")
    hand = np.asarray(joints, dtype=np.float64).reshape(-1, 3)
    palm = hand[skeleton.joint_names.index("palm")]
    move = rounded(palm * cube_mm / 2 + palm_frame(hand, skeleton) @ CENTER_IN_PALM, PLACE_STEP_MM)
    return camera.project(camera.unproject(np.asarray(center_uvd, dtype=np.float64)) + move)
