"""Hands of whole scenes: their capsules, where their parts are, and what they hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules
from handpose.body.joint_formats.frames import LONG_FINGERS
from handpose.synthetic.pose_prior import Bodies, BodySampler
from handpose.synthetic.scenes.directions import across, right_angled, unit
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.prior import HeldParameter
from handpose.synthetic.scenes.solids import CYLINDER, Solids, joined, one_each
from handpose.synthetic.surface_prior import SurfacePrior, draw_capsules
from netlib.blob import Array

SURFACE = SurfacePrior(
    thickness_std=0.1, trunk_std=0.08, radius_std=0.06, offsets=(0.4, 1.6), towards_camera=1.0
)
PALM_RADIUS_MM = 15.0  # from the palm's middle to its surface
FINGERTIP_RADIUS_MM = 9.0
MIN_HELD_RADIUS_MM = 8.0  # of things that are held
HELD_AXIS_STD = 0.15  # deviation of a held thing's axis from the row of knuckles
HELD_SHIFT = 0.7  # maximum shift of a held thing along its axis, relative to its half length


class Hands(NamedTuple):
    """One hand for each of N frames; before they are placed, the palm's middle is at the origin.

    own                     capsules
    wrist, elbow            (N, 3) mm, the ends of the forearm
    arm_radii               (N, 2) mm, of the forearm at both
    palmar, across, distal  (N, 3) directions: away from the palm, along the row of knuckles, from
                            the wrist to the knuckles
    tips                    (N, 4, 3) mm, of the fingers
    middle                  (N, 3) mm, of the joints without the wrist
    joints                  (N, K, 3) mm, the skeleton's
    crop                    (N, 3) mm, the middle of a crop
    bodies                  the hands as they were drawn, as right hands
    side                    (N,) 1 for a right hand, -1 for a left one
    """

    own: Capsules
    wrist: Array
    elbow: Array
    arm_radii: Array
    palmar: Array
    across: Array
    distal: Array
    tips: Array
    middle: Array
    joints: Array
    crop: Array
    bodies: Bodies
    side: Array

    def placed(self, rotation: Array, place: Array) -> Hands:
        """The hands turned by (N, 3, 3) and moved by (N, 3)."""

        def turned(v: Array) -> Array:
            return np.einsum("nij,n...j->n...i", rotation, v)

        own = self.own._replace(a=turned(self.own.a), b=turned(self.own.b)).moved(place)
        return self._replace(
            own=own,
            wrist=turned(self.wrist) + place,
            elbow=turned(self.elbow) + place,
            palmar=turned(self.palmar),
            across=turned(self.across),
            distal=turned(self.distal),
            tips=turned(self.tips) + place[:, None],
            middle=turned(self.middle) + place,
            joints=turned(self.joints) + place[:, None],
            crop=turned(self.crop) + place,
        )


def draw_hands(draw: Draw, sampler: BodySampler, side: Array) -> Hands:
    """Hands of the given sides about the middles of their palms."""
    surface = sampler.surface
    count = draw.count
    bodies = sampler.draw(draw.rng, count)
    unit_mm = sampler.cube_mm / 2
    far = np.tile((0.0, 0.0, 10 * sampler.cube_mm), (count, 1))  # so that none is cut at the camera
    capsules = draw_capsules(draw.rng, SURFACE, surface, bodies, unit_mm, far)
    row = {name: n for n, name in enumerate(sampler.skeleton.joint_names)}
    mirror = np.stack([side, np.ones(count), np.ones(count)], axis=1)
    palm = bodies.joints[:, row["palm"]] * unit_mm
    capsules = capsules.moved(-far - palm).mirrored(mirror)
    joints = (bodies.joints * unit_mm - palm[:, None]) * mirror[:, None]
    wrist, index, little, middle = (
        joints[:, row[name]] for name in ("wrist_middle", "index_mcp", "little_mcp", "middle_mcp")
    )
    arm = int(np.flatnonzero(surface.limbs)[0])
    normal = unit(np.cross(index - wrist, little - wrist))
    tips = [row[f"{finger}_tip"] for finger in LONG_FINGERS]
    without_wrist = [not name.startswith("wrist") for name in row]
    return Hands(
        own=capsules.chosen(~surface.limbs),
        wrist=capsules.a[:, arm],
        elbow=capsules.b[:, arm],
        arm_radii=np.stack([capsules.radius_a[:, arm], capsules.radius_b[:, arm]], axis=1),
        palmar=-side[:, None] * normal,
        across=unit(index - little),
        distal=unit(middle - wrist),
        tips=joints[:, tips],
        middle=joints[:, without_wrist].mean(1),
        joints=joints,
        crop=-palm * mirror,
        bodies=bodies,
        side=side,
    )


def draw_held(
    draw: Draw, prior: HeldParameter, hand: Hands, palm: Array, there: NDArray[np.bool_]
) -> Solids:
    """What the hands hold, up to the palm and the tips of the fingers, and the tops of cylinders.

    palm   (N, 3) middles of the palms
    there  (N,) whether there is a hand
    """
    axis = unit(hand.across + HELD_AXIS_STD * draw.normal(3))
    away_mm = draw(prior.away)
    along = hand.distal * draw(prior.along, 1)
    center = palm + along + hand.palmar * away_mm[:, None]
    up_to_palm = away_mm - PALM_RADIUS_MM
    up_to_tips = _distance_to_tips(hand, center, axis) - FINGERTIP_RADIUS_MM
    touches_tips = draw.chance(prior.touches)
    radius = np.where(touches_tips, np.minimum(up_to_palm, up_to_tips), up_to_palm)
    is_held = there & (radius > MIN_HELD_RADIUS_MM) & draw.chance(prior.share)
    radius = np.maximum(radius, MIN_HELD_RADIUS_MM)
    half_length = draw(prior.length)
    shift = draw.between(-HELD_SHIFT, HELD_SHIFT) * half_length
    center = center + axis * shift[:, None]
    axes = right_angled(unit(across(hand.palmar, axis)), axis)
    kind = draw.rng.integers(3, size=draw.count)
    is_cylinder = kind == CYLINDER
    half_depth = np.where(is_cylinder, radius, radius * draw(prior.flatness))
    half_sizes = np.stack([radius, half_length, half_depth], axis=-1)
    held = one_each(kind, center, axes, half_sizes, is_held)
    top_radius = radius * draw(prior.top_width)
    top_sizes = np.stack([top_radius, draw(prior.top_length), top_radius], axis=-1)
    has_top = is_held & is_cylinder & draw.chance(prior.top)
    top_center = center + axis * half_length[:, None]
    tops = one_each(np.full(draw.count, CYLINDER), top_center, axes, top_sizes, has_top)
    return joined([held, tops])


def _distance_to_tips(hand: Hands, center: Array, axis: Array) -> Array:
    """The distance (N,) of the nearest fingertip from lines through points (N, 3)."""
    to_tips = across(hand.tips - center[:, None], axis[:, None])
    return np.asarray(np.linalg.norm(to_tips, axis=-1).min(1))
