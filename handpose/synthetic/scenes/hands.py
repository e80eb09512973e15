"""Hands of whole scenes: their capsules, where their parts are, and what they hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes.directions import across, right_angled, unit
from handpose.synthetic.scenes.prior import HeldParameter
from handpose.synthetic.scenes.solids import CYLINDER, Solids, joined, one_each
from handpose.synthetic.surface_prior import SurfacePrior, draw_capsules
from netlib.blob import Array

SURFACE = SurfacePrior(
    thickness_std=0.1, trunk_std=0.08, radius_std=0.06, offsets=(0.4, 1.6), towards_camera=1.0
)
FINGERS = ("index", "middle", "ring", "little")
SKIN_MM = 15.0  # from the palm's middle to its surface
FINGER_MM = 9.0  # radius of a fingertip
LEAST_MM = 8.0  # radius of the thinnest thing that is held


class Hands(NamedTuple):
    """One hand for each of N frames: capsules, and places (N, 3) about the palm's middle before
    they are placed.
    """

    own: Capsules
    wrist: Array
    elbow: Array
    arm_radii: Array  # (N, 2)
    palmar: Array  # the palm's direction
    across: Array  # along the row of knuckles
    distal: Array  # from the wrist to the knuckles
    tips: Array  # (N, 4, 3)
    middle: Array  # of the joints without the wrist
    scale: Array  # (N,)
    side: Array  # (N,)

    def placed(self, rotation: Array, place: Array) -> Hands:
        """The hands turned by (N, 3, 3) and moved by (N, 3)."""

        def turned(v: Array) -> Array:
            return np.einsum("nij,n...j->n...i", rotation, v)

        own = self.own._replace(a=turned(self.own.a), b=turned(self.own.b)).moved(place)
        directions = {name: turned(getattr(self, name)) for name in ("palmar", "across", "distal")}
        return self._replace(
            own=own,
            wrist=turned(self.wrist) + place,
            elbow=turned(self.elbow) + place,
            tips=turned(self.tips) + place[:, None],
            middle=turned(self.middle) + place,
            **directions,
        )


def draw_hands(rng: np.random.Generator, sampler: BodySampler, side: Array) -> Hands:
    """Hands of the given sides about the middles of their palms."""
    surface = sampler.surface
    count = len(side)
    bodies = sampler.draw(rng, count)
    unit_mm = sampler.cube_mm / 2
    far = np.tile((0.0, 0.0, 10 * sampler.cube_mm), (count, 1))  # so that none is cut at the camera
    whole = draw_capsules(rng, SURFACE, surface, bodies, unit_mm, far)
    row = {name: n for n, name in enumerate(sampler.skeleton.joint_names)}
    mirror = np.stack([side, np.ones(count), np.ones(count)], axis=1)
    palm = bodies.joints[:, row["palm"]] * unit_mm
    whole = whole.moved(-far - palm).mirrored(mirror)
    joints = (bodies.joints * unit_mm - palm[:, None]) * mirror[:, None]
    wrist, index, little, middle = (
        joints[:, row[name]] for name in ("wrist_middle", "index_mcp", "little_mcp", "middle_mcp")
    )
    limb = int(np.flatnonzero(surface.limbs)[0])
    normal = unit(np.cross(index - wrist, little - wrist))
    tips = [row[f"{finger}_tip"] for finger in FINGERS]
    without_wrist = [not name.startswith("wrist") for name in row]
    return Hands(
        own=whole.chosen(~surface.limbs),
        wrist=whole.a[:, limb],
        elbow=whole.b[:, limb],
        arm_radii=np.stack([whole.radius_a[:, limb], whole.radius_b[:, limb]], axis=1),
        palmar=-side[:, None] * normal,
        across=unit(index - little),
        distal=unit(middle - wrist),
        tips=joints[:, tips],
        middle=joints[:, without_wrist].mean(1),
        scale=bodies.scale,
        side=side,
    )


def draw_held(
    rng: np.random.Generator,
    prior: HeldParameter,
    hand: Hands,
    palm: Array,
    there: NDArray[np.bool_],
) -> Solids:
    """What the hands hold, up to the palm and the tips of the fingers, and the tops of cylinders.

    palm   (N, 3) middles of the palms
    there  (N,) whether there is a hand
    """
    count = len(palm)
    axis = unit(hand.across + 0.15 * rng.normal(size=(count, 3)))
    away = prior.away.draw(rng, count)
    along = hand.distal * prior.along.draw(rng, count, 1)
    center = palm + along + hand.palmar * away[:, None]
    beside = across(hand.tips - center[:, None], axis[:, None])
    up_to_tips = np.linalg.norm(beside, axis=-1).min(1) - FINGER_MM
    up_to_palm = away - SKIN_MM
    touches = rng.random(count) < prior.touches
    radius = np.where(touches, np.minimum(up_to_palm, up_to_tips), up_to_palm)
    is_held = there & (radius > LEAST_MM) & (rng.random(count) < prior.share)
    radius = np.maximum(radius, LEAST_MM)
    length = prior.length.draw(rng, count)
    center = center + axis * (rng.uniform(-0.7, 0.7, count) * length)[:, None]
    axes = right_angled(unit(across(hand.palmar, axis)), axis)
    kind = rng.integers(3, size=count)
    deep = np.where(kind == CYLINDER, radius, radius * prior.flatness.draw(rng, count))
    wider = radius * prior.top_width.draw(rng, count)
    top = np.stack([wider, prior.top_length.draw(rng, count), wider], axis=-1)
    with_top = is_held & (kind == CYLINDER) & (rng.random(count) < prior.top)
    half = np.stack([radius, length, deep], axis=-1)
    at_top = center + axis * length[:, None]
    held = one_each(kind, center, axes, half, is_held)
    tops = one_each(np.full(count, CYLINDER), at_top, axes, top, with_top)
    return joined([held, tops])
