"""A hand as it is estimated in one crop: predicted by a network, and fitted to the depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules
from handpose.body.sides import Side, SideView, as_right, camera_of, mirror_of, pixel_of
from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel, WorldPose, world_pose
from handpose.fit.depth_fit import DepthFit
from handpose.fit.pose_confidence import Evidence, Judge, Judged, unknown_finger_errors
from handpose.frames.cameras import Camera
from handpose.frames.crops import crop_scale
from netlib.blob import Array

Item = TypeVar("Item")

MIN_CONFIDENCE = 0.3  # of a hand whose joints are given, unless the user asks for others
MIN_PRESENCE = 0.25  # 0.1 false hands a frame in scenes of the training's generator, one at a desk


@dataclass(frozen=True)
class HandEstimate:
    """One hand, or one other body, in one crop of a depth image.

    hand        "right" or "left"; "right" for other bodies
    view_crop   (128, 128) in [-1, 1], in the view of its side (``SideView``), as the next one
    view_uvd    (3,) px, px, mm: the crop's centre
    cube_mm     edge of the crop's cube
    camera      of the frame, not of the view
    network_mm  (K, 3) mm from the crop's centre, in the view: the joints predicted by the network
                alone; those expected from earlier frames if it was not run
    fit         of this body alone, in the view. None without a fit
    model       of the fit
    is_tracked  True if the fit started from the pose expected from earlier frames
    other       the same crop fitted as a hand of the other side, if both sides were tried
    error_mm    expected mean error of the joints; NaN before it is judged (``judge``)
    confidence  probability that this error is below 30 mm; NaN likewise
    finger_error_mm  (5,) expected error of each finger, from the thumb on; NaN likewise
    evidence    what the image shows of the pose; None likewise
    presence    probability that this is a hand, by the finder; NaN if its place was given
    in_frame    False for a crop without its frame: then camera and centre are assumed

    The values of the fit are NaN, and its surface and pose are errors, without a fit, and of a hand
    whose joints are withheld (``given``).
    """

    hand: Side
    view_crop: NDArray[np.float32]
    view_uvd: Array
    cube_mm: float
    camera: Camera
    network_mm: Array
    fit: DepthFit | None = None
    model: CapsuleModel | None = None
    is_tracked: bool = False
    presence: float = float("nan")
    in_frame: bool = True
    other: HandEstimate | None = None
    error_mm: float = float("nan")
    confidence: float = float("nan")
    finger_error_mm: Array = field(default_factory=unknown_finger_errors)
    evidence: Evidence | None = None

    # ---------------------------------------------------------------------------------- where it is

    @cached_property
    def view_camera(self) -> Camera:
        """The camera of the view."""
        return camera_of(self.camera, self.hand)

    @cached_property
    def view_center_mm(self) -> Array:
        """(3,) crop centre in mm, in the view."""
        return self.view_camera.unproject(self.view_uvd)

    @property
    def view_joints_mm(self) -> Array:
        """(K, 3) mm from the crop's centre, in the view."""
        return self.network_mm if self.fit is None else self.fit.joints[0]

    @property
    def crop(self) -> NDArray[np.float32]:
        """(128, 128) in [-1, 1], as the camera sees it."""
        return as_right(self.view_crop, self.hand)

    @property
    def center_uvd(self) -> Array:
        """(3,) px, px, mm: the crop's centre."""
        return pixel_of(self.view_uvd, self.camera, self.hand)

    @property
    def center_mm(self) -> Array:
        """(3,) crop centre in mm, camera axes."""
        return self.view_center_mm * mirror_of(self.hand)

    @cached_property
    def joints_mm(self) -> Array:
        """(K, 3) mm from the crop's centre, camera axes."""
        return self.view_joints_mm * mirror_of(self.hand)

    @property
    def joints(self) -> Array:
        """(K, 3) half-cubes from the crop's centre: x right, y up, z away from the camera."""
        return self.joints_mm / (self.cube_mm / 2)

    @property
    def xyz(self) -> Array:
        """(K, 3) joints in mm, camera axes."""
        return self.center_mm + self.joints_mm

    # ------------------------------------------------------------------------------- how sure it is

    @property
    def chance(self) -> float:
        """The confidence; if it is unknown, 1 for a visible hand and otherwise 0."""
        return self.confidence if np.isfinite(self.confidence) else float(np.isfinite(self.cost))

    @property
    def cost(self) -> float:
        """The cost of the fit: the sum of all terms; infinite if the crop shows nothing."""
        return float("nan") if self.fit is None else float(self.fit.cost[0])

    @property
    def selection_cost(self) -> float:
        """Compares poses: the expected error in mm, or the cost if it is unknown."""
        return self.cost if np.isnan(self.error_mm) else self.error_mm

    @property
    def has_joints(self) -> bool:
        """False if the joints are withheld."""
        return bool(np.isfinite(self.network_mm).all())

    def given(self, min_confidence: float) -> HandEstimate:
        """This hand; below the minimum confidence without its joints, which are NaN, and
        without its fit.

        The place of its crop, its confidence and its expected error remain. A confidence that is
        unknown is not below.
        """
        if not self.confidence < min_confidence:
            return self
        return replace(self, network_mm=np.full_like(self.network_mm, np.nan), fit=None, other=None)

    # ------------------------------------------------------------------------------ what was fitted

    @property
    def size(self) -> float:
        """The scale relative to the skeleton: of bones, offsets and radii."""
        return float("nan") if self.fit is None else float(np.exp(self.x[SIZE_INDEX]))

    @property
    def thickness(self) -> float:
        """The additional scale of the radii."""
        return float(np.exp(self.x[THICKNESS_INDEX]))

    @property
    def x(self) -> Array:
        """(V,) the variables of the model; for a left hand, those of its mirror image."""
        return self.the_fit.x[0]

    @property
    def inputs(self) -> Array:
        """(D,) of the skeleton; for a left hand, those of its mirror image."""
        return self.the_model.inputs_of(self.the_fit.x)[0]

    @property
    def whole_inputs(self) -> Array:
        """(D',) of the whole body, likewise: ``inputs`` and the degrees of freedom of the
        surface alone.
        """
        return self.the_model.whole_inputs_of(self.the_fit.x)[0]

    @cached_property
    def body(self) -> WorldPose:
        """The pose in space, in the view.

        Raises NetlibError for bodies that cannot be followed.
        """
        return world_pose(self.the_model, self.x, self.view_center_mm)

    def capsules(self, *, in_space: bool = False) -> Capsules:
        """The surface in mm, camera axes, from the crop's centre, or from the camera."""
        origin = self.view_center_mm if in_space else np.zeros(3)
        return self.the_model.capsules(self.the_fit.x, origin[None]).mirrored(mirror_of(self.hand))

    @property
    def the_fit(self) -> DepthFit:
        """The fit; an error without one."""
        assert self.fit is not None, "a hand without a fit"
        return self.fit

    @property
    def the_model(self) -> CapsuleModel:
        """The model of the fit; an error without one."""
        assert self.model is not None, "a hand without a fit"
        return self.model


def judge(hands: Sequence[HandEstimate], view: SideView | None, by: Judge) -> list[HandEstimate]:
    """Fitted hands of one body and cube with the error and the confidence of their poses, by what
    the frame of all of them shows; each by its crop alone without one.
    """
    if view is None:
        return [_judge([hand], *_as_frame(hand), by)[0] for hand in hands]

    def of_one_side(some: Sequence[HandEstimate]) -> list[HandEstimate]:
        seen = view.of(some[0].hand)
        return _judge(some, np.asarray(seen.readings, np.float32), seen.camera, by)

    return in_groups(hands, lambda hand: hand.hand, of_one_side)


def in_groups(
    items: Sequence[Item],
    group_of: Callable[[Item], object],
    results_of: Callable[[Sequence[Item]], Sequence[HandEstimate]],
) -> list[HandEstimate]:
    """The results for items in their order, computed for the items of each group together."""
    groups: dict[object, list[int]] = {}
    for n, item in enumerate(items):
        groups.setdefault(group_of(item), []).append(n)
    found: dict[int, HandEstimate] = {}
    for rows in groups.values():
        found |= zip(rows, results_of([items[n] for n in rows]))
    return [found[n] for n in range(len(items))]


def _judge(
    hands: Sequence[HandEstimate], readings: NDArray[np.float32], camera: Camera, by: Judge
) -> list[HandEstimate]:
    """Hands of one side, by an image in their view."""
    fits = DepthFit.concatenate([hand.the_fit for hand in hands])
    center = np.stack([hand.view_center_mm for hand in hands])
    evidence = by.evidence_of(hands[0].the_model, fits, center, readings, camera)
    found = by.judged(evidence)
    return [
        replace(with_quality(hand, found, n), evidence=evidence.take(slice(n, n + 1)))
        for n, hand in enumerate(hands)
    ]


def with_quality(hand: HandEstimate, found: Judged, n: int) -> HandEstimate:
    """A hand with the errors and the confidence of the judged pose ``n``."""
    return replace(
        hand,
        error_mm=float(found.error_mm[n]),
        confidence=float(found.confidence[n]),
        finger_error_mm=found.finger_error_mm[n],
    )


def _as_frame(hand: HandEstimate) -> tuple[NDArray[np.float32], Camera]:
    """A hand's crop as a depth image in mm, and its camera."""
    camera = hand.view_camera
    size = len(hand.view_crop)
    offset, factor = crop_scale(hand.view_uvd[None], hand.cube_mm, camera, size)
    fx, fy = factor[0] * (camera.fx, camera.fy)
    u0, v0 = offset[0] + factor[0] * (camera.u0, camera.v0)
    depth = hand.view_uvd[2] + hand.view_crop * (hand.cube_mm / 2)
    return depth.astype(np.float32), replace(
        camera, fx=fx, fy=fy, u0=u0, v0=v0, width=size, height=size
    )


def as_one_side(hand: HandEstimate, by: Judge) -> HandEstimate:
    """A hand that was fitted as either side, with the errors and the confidence if the
    side may be wrong.

    The confidence is multiplied by the probability of this side, and the expected errors of the
    hand and of its fingers are those of this side or the distances of the other's joints, weighted
    by the probabilities.
    """
    other = hand.other
    if other is None or np.isnan(hand.confidence):
        return hand
    chance = by.side_chance(by.side_log_ratio(hand.cost, other.cost))
    apart = np.linalg.norm(hand.xyz - other.xyz, axis=1)
    error_mm = chance * hand.error_mm + (1 - chance) * max(float(apart.mean()), hand.error_mm)
    of_fingers = hand.finger_error_mm
    fingers = hand.the_model.fingers
    if fingers is not None:
        own = fingers.joints(np.stack([hand.xyz, other.xyz]))
        apart = np.linalg.norm(own[0] - own[1], axis=2).mean(axis=1)
        of_fingers = chance * of_fingers + (1 - chance) * np.maximum(apart, of_fingers)
    return replace(
        hand, error_mm=error_mm, confidence=chance * hand.confidence, finger_error_mm=of_fingers
    )
