"""The capsule model of a body as a function of few variables, and the derivatives of the
capsules' ends.

The variables x (N, V) of a frame are the free inputs of the whole body, including those of the
surface alone. The last two are the logarithms of its size, which scales bones, offsets and radii,
and of its thickness, which also scales the radii. With a capsule's end E_j = X_j + R_f o_j
(``handpose.body``), a rotation about the unit axis a through P moves

    dE_j / dx  =  [moves X_j] a x (X_j - P)  +  [turns f] a x (R_f o_j)        a translation: a
    dE_j / d log size  =  E_j - (position of the root)

A point between two ends moves with them, c = (1 - s) E_i + s E_j, so no other derivative of the
body is needed (``residuals``).

Lengths here are in mm: those of the skeleton times ``unit_mm``.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.capsules import Capsules
from handpose.body.model import Fingers, Surface, has_fingers
from handpose.frames.cameras import Floats
from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Pose, rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import NetlibError

SIZE_INDEX, THICKNESS_INDEX = -2, -1  # indices into x
MIN_SIZE, MAX_SIZE = 0.66, 1.35  # relative to the skeleton's; the recipe `people` has 0.69 to 1.15
THICKNESS_LIMIT = 0.3  # bound of its logarithm
TYPICAL_SIZE = 0.92  # mean size of the recipe `people`, relative to the skeleton


class Posed(NamedTuple):
    """The capsules of N bodies in mm, and their derivatives.

    E of the joints are ends of capsules.
    """

    ends: Floats  # (N, E, 3)
    motion: Floats  # (N, E, 3, V): derivatives of the ends
    thickness: Floats  # (N,) scale of all radii


class CapsuleModel:
    """The capsules of a skeleton with a surface, for fitting.

    free          (V - 2,) the DoFs of the whole body that are variables; then come log size
                  and log thickness
    lower, upper  (V,) limits
    root          indices of the variables that move the whole body
    limbs         indices of the variables that move a part of the skeleton
    own           indices of the variables that the surface alone has
    deviation     (V - 2,) standard deviations of the inputs; not finite where the file has none
    rigid         indices of the ends that move with the root alone
    kinematics    of the skeleton
    start, end    (M,) the capsules' ends, among the E
    radii         (M, 2) mm
    """

    def __init__(self, skeleton: Skeleton, unit_mm: float) -> None:
        self.surface = surface = Surface(skeleton)
        self.skeleton, self.whole, self.unit_mm = skeleton, surface.whole, unit_mm
        whole = self.whole
        self.kinematics = kinematics_of(skeleton)
        self._whole_kinematics = kinematics_of(whole)
        self._root_joint = _root_of(skeleton.name, whole)
        self._motions = motions = _EndMotions(surface)
        self.free = motions.free
        self.lower = np.append(whole.lower[self.free], [np.log(MIN_SIZE), -THICKNESS_LIMIT])
        self.upper = np.append(whole.upper[self.free], [np.log(MAX_SIZE), THICKNESS_LIMIT])
        self.deviation = surface.deviation[self.free]
        self.root = motions.moving(self._root_joint)
        self.own = np.flatnonzero(self.free >= len(skeleton.initial))
        self.limbs = np.setdiff1d(np.arange(len(self.free)), np.concatenate([self.root, self.own]))
        self.start = np.searchsorted(motions.joints, surface.start)
        self.end = np.searchsorted(motions.joints, surface.end)
        self.radii = (surface.radii * unit_mm).astype(np.float32)
        self.rigid = motions.moved_only_by(self.free[self.root])

    @cached_property
    def root_motion(self) -> RootMotion:
        """The motion of the body as a whole.

        Raises NetlibError for a root that ``RootMotion`` does not accept.
        """
        return RootMotion(self)

    @cached_property
    def fingers(self) -> Fingers | None:
        """The fingers; None for a body that is not a hand."""
        return Fingers(self.surface) if has_fingers(self.skeleton) else None

    @property
    def variables(self) -> int:
        """The number of variables V."""
        return len(self.free) + 2

    def variables_of(self, inputs: ArrayLike) -> Array:
        """x (N, V) for the skeleton's inputs (N, D) at the skeleton's size; limbs are clipped
        to their limits.
        """
        given = np.asarray(inputs, dtype=np.float64)
        x = np.zeros((len(given), self.variables))
        skeletons = self.free < given.shape[1]
        x[:, :SIZE_INDEX][:, skeletons] = given[:, self.free[skeletons]]
        limbs = self.limbs
        x[:, limbs] = np.clip(x[:, limbs], self.lower[limbs], self.upper[limbs])
        return x

    def inputs_of(self, x: Array) -> Array:
        """The skeleton's inputs (N, D) of x (N, V)."""
        return self.whole_inputs_of(x)[:, : len(self.skeleton.initial)]

    def whole_inputs_of(self, x: Array) -> Array:
        """The whole body's inputs (N, D'): the skeleton's, then those of the surface alone."""
        inputs = np.zeros((len(x), len(self.whole.initial)))
        inputs[:, self.free] = x[:, :SIZE_INDEX]
        return inputs

    def joints(self, x: Array) -> Array:
        """The skeleton's joints (N, K, 3) in mm."""
        bones = self.skeleton.bones * np.exp(x[:, [SIZE_INDEX]])
        return self.kinematics.joints(self.inputs_of(x), bones) * self.unit_mm

    def ends(self, x: Array) -> Floats:
        """The ends of the capsules (N, E, 3) at x (N, V)."""
        return self._ends(x)[1]

    def posed(self, x: Array) -> Posed:
        """The capsules' ends and their derivatives at x (N, V)."""
        joints, ends, pose = self._ends(x)
        axis, pivot = self._whole_kinematics.axes(pose)
        motion = self._motions.derivatives(ends, joints, axis, pivot, np.float32(self.unit_mm))
        motion[..., SIZE_INDEX] = ends - joints[:, [self._root_joint]]
        return Posed(ends, motion, self._thickness(x).astype(np.float32))

    def capsules(self, x: Array, center_mm: Array) -> Capsules:
        """All capsules at x (N, V), for the renderer; ``center_mm`` (N, 3) is the position
        of the origin.
        """
        ends = self.ends(x).astype(np.float64) + center_mm[:, None]
        radii = self.radii.astype(np.float64) * self._thickness(x)[:, None, None]
        a, b = ends[:, self.start], ends[:, self.end]
        return Capsules(a, b, radii[:, :, 0], radii[:, :, 1], self.surface.facets)

    def _ends(self, x: Array) -> tuple[Floats, Floats, Pose]:
        """All joints (N, K, 3), the capsules' ends (N, E, 3), and their pose."""
        unit = np.float32(self.unit_mm)
        size = np.exp(x[:, SIZE_INDEX])
        bones = self.whole.bones * size[:, None]
        pose = self._whole_kinematics.forward_pose(self.whole_inputs_of(x), bones)
        joints = np.asarray(pose.joints, np.float32) * unit
        rotations = {
            f: np.asarray(self._whole_kinematics.rotation_of(pose, f), np.float32)
            for f in self.surface.offsets
        }
        ends = self.surface.ends_at(joints, rotations, (size * unit).astype(np.float32))
        return joints, ends[:, self._motions.joints], pose

    def _thickness(self, x: Array) -> Array:
        """The scale of all radii (N,)."""
        return np.exp(x[:, SIZE_INDEX] + x[:, THICKNESS_INDEX])


def _root_of(name: str, whole: Skeleton) -> int:
    """The root of a body. Raises NetlibError for one with which a body cannot be placed."""
    roots = np.flatnonzero(whole.parents < 0)
    sliding = {j for j, own in enumerate(whole.motions) for m in own if m.kind == "translate"}
    if len(roots) != 1 or whole.bone_axes[roots[0]] >= 0 or not sliding.issubset(roots):
        raise NetlibError(
            f"skeleton {name!r}: expected one root, without a bone, that alone translates"
        )
    return int(roots[0])


class _EndMotions:
    """How the Q motions of the whole body move the E ends of the capsules of a surface.

    free    (F,) the DoFs that drive the motions
    joints  (E,) the joints at which capsules end
    """

    def __init__(self, surface: Surface) -> None:
        self._whole = whole = surface.whole
        self.free = np.unique(whole.driven)
        self.joints = np.unique(np.concatenate([surface.start, surface.end]))
        # motions in the order of the DoFs, of which some may drive several
        self._order = np.argsort(whole.driven, kind="stable")
        driven = whole.driven[self._order]
        self._one_each = np.array_equal(driven, self.free)
        self._sums = (driven[:, None] == self.free).astype(float)
        with_joint = whole.moves[:, self.joints].T  # (E, Q): motions that move E_j with X_j
        with_axes = with_joint.copy()
        for f, (own_joints, _) in surface.offsets.items():
            own = np.isin(self.joints, own_joints)
            with_axes[own] = whole.moves[:, f]
        unlike = (with_joint != with_axes) & whole.turns
        self._moves = with_joint | unlike
        self._with_joint = with_joint[:, self._order].astype(np.float32)
        # ends E_j that some motion moves unlike X_j
        self._apart = np.flatnonzero(unlike.any(axis=1))
        only_axes = unlike * np.where(with_axes, 1, -1)
        self._only_axes = only_axes[self._apart][:, self._order].astype(np.float32)
        self._turns = whole.turns[self._order].astype(np.float32)

    def moving(self, joint: int) -> NDArray[np.int_]:
        """The indices of the free DoFs that move a joint."""
        moves = self._sums.T @ self._whole.moves[self._order, joint]
        return np.flatnonzero(moves > 0)

    def moved_only_by(self, dofs: NDArray[np.int_]) -> NDArray[np.int_]:
        """The indices of the ends that only some DoFs move."""
        others = ~np.isin(self._whole.driven, dofs)
        return np.flatnonzero(~self._moves[:, others].any(axis=1))

    def derivatives(
        self, ends: Floats, joints: Floats, axis: Array, pivot: Array, unit_mm: np.float32
    ) -> Floats:
        """The derivatives (N, E, 3, F + 2) of ends (N, E, 3) by the DoFs; those by size and
        thickness are 0.

        joints       (N, K, 3) of the whole body
        axis, pivot  (N, Q, 3) of the motions
        """
        N, E, _ = ends.shape
        ordered = (v[:, self._order] for v in (axis, pivot))
        # (3, N, Q)
        axis, pivot = (np.ascontiguousarray(v.transpose(2, 0, 1), np.float32) for v in ordered)
        turn = axis * self._turns
        shift = (axis - turn - _cross(turn, pivot)) * unit_mm
        turn = turn[:, :, None]
        Q = len(self._order)
        motion = np.zeros((N, E, 3, Q + 2), np.float32)
        by_axis = motion[..., :Q].transpose(2, 0, 1, 3)
        moved = _cross(turn, _columns(ends))  # a turn moves E by a x E - a x P
        moved += shift[:, :, None]
        np.multiply(moved, self._with_joint, out=by_axis)
        if len(self._apart):
            offsets = ends[:, self._apart] - joints[:, self.joints[self._apart]]
            by_axis[:, :, self._apart] += _cross(turn, _columns(offsets)) * self._only_axes
        if self._one_each:
            return motion
        by_dof = (motion[..., :Q] @ self._sums).astype(np.float32)
        return np.concatenate([by_dof, motion[..., Q:]], axis=-1)


def _columns(points: Floats) -> Floats:
    """(3, N, E, 1) of points (N, E, 3)."""
    return points.transpose(2, 0, 1)[..., None]


def _cross(a: Floats, X: Floats) -> Floats:
    """The cross product along the first axis, (3, ...); a matrix product would depend on
    the processor.
    """
    out = np.empty((3, *np.broadcast_shapes(a.shape[1:], X.shape[1:])), np.float32)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], X[k], out=out[i])
        out[i] -= a[k] * X[j]
    return out


class RootMotion:
    """Converts between variables x (N, V) and the root's position and rotation.

    Angles about three axes are discontinuous at a pole. So whatever moves a body as a whole works
    with a rotation matrix, and converts it to the variables last.

    columns  (6,) of x: three translations along x, y, z, and three rotations in their order
    others   (V - 6,) the other variables

    Raises NetlibError for a skeleton whose root does not translate along x, y, z and rotate about
    three different axes, with a free DoF each.
    """

    def __init__(self, model: CapsuleModel) -> None:
        whole = model.whole
        motions = whole.motions[int(np.flatnonzero(whole.parents < 0)[0])]
        slides = {m.axis: m for m in motions if m.kind == "translate"}
        turns = [m for m in motions if m.kind == "rotate"]
        column = {int(dof): i for i, dof in enumerate(model.free)}
        free = {m.dof for m in motions} & set(column)
        along_and_about_each = set(slides) == {m.axis for m in turns} == {0, 1, 2}
        if not along_and_about_each or len(motions) != 6 or len(free) != 6:
            raise NetlibError(
                f"skeleton {model.skeleton.name!r}: its root does not translate along x, y, z and turn about three "
                "axes, by a free DoF each, so that it can neither be followed through space nor turned with the "
                "picture; expected a plan without quarter turns (fast)"
            )
        ordered = [slides[axis] for axis in range(3)] + turns
        self.columns = np.array([column[m.dof] for m in ordered])
        self.others = np.setdiff1d(np.arange(model.variables), self.columns)
        self._signs = np.array([m.sign for m in ordered], dtype=float)
        self._signs[:3] *= model.unit_mm
        self._initial = np.array([whole.initial[m.dof] for m in ordered])
        self._axes = [m.axis for m in turns]
        i, j, _ = self._axes
        self._parity = 1.0 if (j - i) % 3 == 1 else -1.0

    def place(self, x: Array) -> Array:
        """The root's position (N, 3) in mm from the crop's centre."""
        inputs = x[:, self.columns[:3]] + self._initial[:3]
        return inputs * self._signs[:3]

    def rotation(self, x: Array) -> Array:
        """The root's rotation world_from_root (N, 3, 3)."""
        angles = (x[:, self.columns[3:]] + self._initial[3:]) * self._signs[3:]
        first, second, third = (rotation(axis, angle) for axis, angle in zip(self._axes, angles.T))
        return first @ second @ third

    def variables(self, place: Array, R: Array) -> Array:
        """The variables (N, 6) of ``columns`` for positions (N, 3) and rotations (N, 3, 3);
        angles in [-pi, pi).
        """
        x = np.concatenate([place, self._angles(R)], axis=1) / self._signs - self._initial
        angles = x[:, 3:]
        x[:, 3:] = (angles + np.pi) % (2 * np.pi) - np.pi
        return x

    def _angles(self, R: Array) -> Array:
        """The angles (N, 3) of R = R_i(a) R_j(b) R_k(c) with the root's axes i, j, k."""
        (i, j, k), e = self._axes, self._parity
        pole = np.abs(R[:, i, k]) > 1 - 1e-12  # only the sum of the other angles is determined
        sum_at_pole = np.arctan2(e * R[:, k, j], R[:, j, j])
        a = np.arctan2(-e * R[:, j, k], R[:, k, k])
        b = np.arcsin(np.clip(e * R[:, i, k], -1, 1))
        c = np.arctan2(-e * R[:, i, j], R[:, i, i])
        a, c = np.where(pole, sum_at_pole, a), np.where(pole, 0.0, c)
        return np.stack([a, b, c], axis=1)


class WorldPose(NamedTuple):
    """The variables of a body, independent of the crop in which it was fitted.

    A left hand is in mirrored space, as in the fit. The orientation is one rotation: angles about
    three axes are discontinuous at a pole, and do not measure angular speed.

    place     (3,) mm, position of the root from the camera, in the axes of the (mirrored) camera
    rotation  (3, 3) world_from_root
    others    (V - 6,) the other variables: limbs, the surface's own, logarithms of
              size and thickness

    A step (V,) from one pose to another has mm, the turn about the world's axes
    (its axis times its angle, at most half a turn), and the differences of the other variables.
    Divided by a time it is a velocity.
    """

    place: Array
    rotation: Array
    others: Array

    def step_to(self, other: WorldPose) -> Array:
        """The step (V,) that leads to another pose."""
        turn = cv2.Rodrigues(other.rotation @ self.rotation.T)[0].reshape(3)
        return np.concatenate([other.place - self.place, turn, other.others - self.others])

    def moved(self, step: Array) -> WorldPose:
        """The pose after a step (V,)."""
        rotation = cv2.Rodrigues(step[3:6])[0] @ self.rotation
        return WorldPose(self.place + step[:3], rotation, self.others + step[6:])


def world_pose(model: CapsuleModel, x: Array, center_mm: Array) -> WorldPose:
    """The body with x (V,) about a crop's centre (3,).

    Raises NetlibError for a root that cannot be followed.
    """
    root = model.root_motion
    rows = x[None]
    return WorldPose(root.place(rows)[0] + center_mm, root.rotation(rows)[0], x[root.others])


def crop_variables(model: CapsuleModel, body: WorldPose, center_mm: Array) -> Array:
    """x (V,) of a body about a crop's centre (3,), with the root's angles between -pi and pi.

    Raises NetlibError.
    """
    root = model.root_motion
    x = np.empty(model.variables)
    x[root.others] = body.others
    x[root.columns] = root.variables((body.place - center_mm)[None], body.rotation[None])[0]
    return x
