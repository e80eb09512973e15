r"""Joint angles that can be compared: one canonical form of the poses that are the same, and
errors in degrees.

Different angles can mean the same pose of every bone. All such pairs follow from one identity: for
three different axes a, b, c a half turn about all three does nothing, and a half turn about c
changes the sign of a and b, so

    R_a(p) R_b(q)  =  R_a(p + pi) R_b(pi - q) R_c(pi)

- A joint that turns about a, b and c in a row (the NYU hand's root: z, x, y) takes the half turn
  into its third angle.
- A joint that turns about a and b only (as limbs often begin) passes it down to its children. If
  all bones below lie along c, they do not change, and every angle about a or b below changes its
  sign; an angle about c stays.

``canonical`` chooses, of the two, the third-angle kind with the second angle between -90 and
90 degrees, the other kind with the angles nearest to the initial pose, and wraps every angle
into (-180, 180].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from layers.hand.skeleton import Skeleton
from netlib.blob import Array

ROUNDING = 1e-9  # radians, by which an angle at a limit may exceed it


@dataclass(frozen=True)
class Flip:
    """The other angles of the same pose: the DoFs that turn by 180 degrees, that mirror,
    that change sign.
    """

    turned: list[int]  # t -> t + pi
    mirrored: int  # t -> pi - t
    negated: list[int]  # t -> -t
    whole: bool  # about three axes: nothing below changes

    @property
    def changed(self) -> list[int]:
        """All DoFs that change."""
        return [*self.turned, self.mirrored, *self.negated]

    def applied(self, theta: Array) -> Array:
        """The other values (N, D) of the DoFs in the poses of ``theta`` (N, D)."""
        other = theta.copy()
        other[:, self.turned] += np.pi
        other[:, self.mirrored] = np.pi - theta[:, self.mirrored]
        other[:, self.negated] *= -1
        return other


def wrap(angles: ArrayLike) -> Array:
    """Angles in radians moved by full turns into (-pi, pi]."""
    return np.pi - (np.pi - np.asarray(angles, dtype=np.float64)) % (2 * np.pi)


def rotations(skeleton: Skeleton) -> NDArray[np.int_]:
    """The free DoFs that are rotations, ascending: 23 of the NYU hand."""
    return np.unique(skeleton.driven[skeleton.turns])


def flips(skeleton: Skeleton) -> list[Flip]:
    """The pairs of angles that mean one pose, from the roots to the tips; none with a DoF of
    several joints.
    """
    found = []
    driven = skeleton.driven.tolist()
    for joint, motions in enumerate(skeleton.motions):
        all_turns = tuple(motion for motion in motions if motion.kind == "rotate")
        turns = tuple(motion for motion in all_turns if motion.row >= 0)
        # a DoF of several joints cannot flip in one
        if any(driven.count(motion.dof) > 1 for motion in turns):
            continue
        if len(turns) == 3 and turns == all_turns:
            a, b, c = turns
            if len({a.axis, b.axis, c.axis}) == 3:
                found.append(Flip([a.dof, c.dof], b.dof, [], whole=True))
        elif len(turns) == 2 and motions[-2:] == turns:
            a, b = turns
            if a.axis == b.axis:
                continue
            negated = _passed_down(skeleton, joint, 3 - a.axis - b.axis)
            if negated is not None and not any(driven.count(dof) > 1 for dof in negated):
                found.append(Flip([a.dof], b.dof, negated, whole=False))
    return found


def _passed_down(skeleton: Skeleton, joint: int, c: int) -> list[int] | None:
    """The DoFs below that change sign when the joint's frame makes a half turn about
    its axis ``c``.

    None if a bone, a fixed rotation or a translation below changes.
    """
    if skeleton.bone_axes[joint] not in (c, -1):
        return None
    negated = []
    for child in np.flatnonzero(skeleton.parents == joint):
        for motion in skeleton.motions[child]:
            if motion.kind != "rotate" or motion.row < 0:
                return None
            if motion.axis != c:
                negated.append(motion.dof)
        below = _passed_down(skeleton, int(child), c)
        if below is None:
            return None
        negated += below
    return negated


def canonical(skeleton: Skeleton, inputs: ArrayLike, *, limits: bool = False) -> Array:
    """The canonical inputs (N, D), in radians, of the same poses as ``inputs`` (N, D);
    rotations in (-pi, pi].

    limits  do nothing to an angle that would take it out of the skeleton's limits
    """
    theta = skeleton.theta(np.asarray(inputs, dtype=np.float64))
    for flip in flips(skeleton):
        other = flip.applied(theta)
        if flip.whole:
            better = np.abs(wrap(theta[:, flip.mirrored])) > np.pi / 2
        else:
            away = wrap((theta - skeleton.initial)[:, flip.changed])
            other_away = wrap((other - skeleton.initial)[:, flip.changed])
            better = (other_away**2).sum(axis=1) < (away**2).sum(axis=1)
        if limits:
            better &= _within_limits(skeleton, other - skeleton.initial)[:, flip.changed].all(
                axis=1
            )
        theta[better] = other[better]
    result = theta - skeleton.initial
    turning = rotations(skeleton)
    wrapped = wrap(result[:, turning])
    if limits:
        is_within = _within_limits(skeleton, result)[:, turning]
        wrapped = np.where(is_within, wrapped, result[:, turning])
    result[:, turning] = wrapped
    result[:, skeleton.fixed] = 0
    return result


def _within_limits(skeleton: Skeleton, inputs: Array) -> NDArray[np.bool_]:
    """Whether each of the inputs (N, D), as a wrapped angle, is within its limits, but for
    rounding.
    """
    x = wrap(inputs)
    return (x >= skeleton.lower - ROUNDING) & (x <= skeleton.upper + ROUNDING)


def angle_errors(skeleton: Skeleton, inputs: ArrayLike, truth: ArrayLike) -> Array:
    """Differences (N, R) in degrees, 0 to 180, between inputs (N, D) and the true ones, both in
    canonical form.

    Of all R free rotations; the paper's "mean rotation angle error" is the mean.
    """
    chosen = rotations(skeleton)
    difference = canonical(skeleton, inputs)[:, chosen] - canonical(skeleton, truth)[:, chosen]
    return np.rad2deg(np.abs(wrap(difference)))
