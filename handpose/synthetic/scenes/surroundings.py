"""What stands around hands: a table, things on it, in the air and in the room, floor and walls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic.scenes.directions import across, dot, right_angled, unit
from handpose.synthetic.scenes.draws import Draw, Range
from handpose.synthetic.scenes.people import People, Torsos
from handpose.synthetic.scenes.prior import (
    PartParameter,
    PlanesParameter,
    TableParameter,
    ThingParameter,
    ThingsParameter,
)
from handpose.synthetic.scenes.solids import (
    BOX,
    NOTHING,
    SHAPES,
    Rays,
    Solids,
    joined,
    one_each,
    only,
    plane_depth,
)
from layers.hand.kinematics import rotation
from netlib.blob import Array

ANY_ANGLE = Range(0.0, 2 * np.pi)
LYING = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])  # exchanges the upward and the right axis


class Table(NamedTuple):
    """A board for each of N frames.

    top   (N, 3) a point of its upper face
    axes  (N, 3, 3) along its sides; the second is its normal
    """

    board: Solids
    top: Array
    axes: Array
    there: NDArray[np.bool_]


def draw_table(
    draw: Draw, prior: TableParameter, people: People, near: Array, rests_mm: Range
) -> Table:
    """A table below ``near`` (N, 3), or under the first hands that rest on it."""
    person = people.person
    rests = people.rests
    below = np.where(draw.chance(prior.near), draw(prior.near_mm), draw(prior.below_mm))
    below = np.where(rests, draw(rests_mm), below)[:, None]
    side = _turned(draw(ANY_ANGLE, 1), person.right, person.face)
    level = person.up + prior.tilt * draw.normal(3)
    # a hand at rest lies flat: its own direction says how the table is turned
    normal = unit(np.where(rests[:, None], -people.hands[0].palmar, level))
    above = np.where(rests[:, None], people.palms[:, 0], near)
    axes = right_angled(unit(across(side, normal)), normal)
    top = above - normal * below
    center = top - prior.thickness * normal
    ahead, aside = draw(prior.ahead, 1), draw(prior.aside, 1)
    center = center + across(person.face * ahead + person.right * aside, normal)
    half_x, half_z = draw(prior.half), draw(prior.half)
    half = np.stack([half_x, np.full(draw.count, prior.thickness), half_z], axis=-1)
    there = draw.chance(prior.share) | rests
    board = one_each(np.full(draw.count, BOX), center, axes, half, there)
    return Table(board, top, axes, there)


def draw_things(
    draw: Draw, prior: ThingsParameter, person: Torsos, near: Array, table: Table
) -> tuple[Solids, NDArray[np.int_]]:
    """Some things in each frame, each of one or several solids, M in all; and which of the prior's
    things these belong to (M,).
    """
    shares = np.array([thing.share for thing in prior.thing])
    kinds = draw.rng.choice(len(shares), (draw.count, prior.most), p=shares / shares.sum())
    shown = draw.rng.random(kinds.shape) < prior.each
    shown &= draw.chance(prior.share)[:, None]
    places = _Places(prior, person.up, near, table)
    groups = []
    for k, thing in enumerate(prior.thing):
        frame, _ = np.nonzero(shown & (kinds == k))
        solids = places.solids(Draw(draw.rng, len(frame)), thing, frame)
        groups.append(_by_frame(solids, frame, draw.count))
    of = [np.full(group.kind.shape[1], k) for k, group in enumerate(groups)]
    return joined(groups), np.concatenate(of)


def _by_frame(things: Solids, frame: NDArray[np.int_], count: int) -> Solids:
    """The solids of K things, which are in the given frames (K,), frame by frame."""
    many = np.bincount(frame, minlength=count)
    most = int(many.max(initial=0))
    each = things.kind.shape[1]
    first = np.cumsum(many) - many
    slot = np.arange(len(frame)) - first[frame]

    def spread(values: Array) -> Array:
        out = np.zeros((count, most, *values.shape[1:]), values.dtype)
        out[frame, slot] = values
        return out.reshape(count, most * each, *values.shape[2:])

    return Solids(*map(spread, things))


class _Places(NamedTuple):
    """Where things are: about the places ``near`` (N, 3), and on the tables of N frames."""

    prior: ThingsParameter
    up: Array
    near: Array
    table: Table

    def solids(self, draw: Draw, thing: ThingParameter, frame: NDArray[np.int_]) -> Solids:
        """The parts of one kind of thing, K times in the given frames (K,), thing by thing."""
        size = draw(thing.size)[:, None]
        origin, axes = self._placed(draw, thing, frame)
        return joined([_solid_of(draw, part, origin, axes, size) for part in thing.part])

    def _placed(
        self, draw: Draw, thing: ThingParameter, frame: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        """Origins (K, 3) and axes (K, 3, 3) of things of one kind in the given frames (K,)."""
        # drawn for all things, though only those on tables need it, so that scenes do not change
        angle = draw(ANY_ANGLE, 1)
        near = self.near[frame]
        if thing.stands == "ROOM":  # upright, anywhere
            up = self.up[frame]
            side = unit(across(draw.direction(), up))
            away = draw(self.prior.in_room, 1)
            return near + away * unit(draw.direction() + 0.5 * side), right_angled(side, up)
        origin = near + draw.direction() * draw(self.prior.in_air, 1)
        axes = draw.rotation()
        if thing.stands == "AIR":
            return origin, axes
        on_table, upright = self._on_table(draw, frame, angle, thing.lies)
        has_table = self.table.there[frame]
        origin = np.where(has_table[:, None], on_table, origin)
        return origin, np.where(has_table[:, None, None], upright, axes)

    def _on_table(
        self, draw: Draw, frame: NDArray[np.int_], angle: Array, lies: float
    ) -> tuple[Array, Array]:
        """At directions with these angles (K, 1) from the middle of the tables; a share lies."""
        x, normal, z = np.moveaxis(self.table.axes[frame], -1, 0)
        origin = self.table.top[frame] + _turned(angle, x, z) * draw(self.prior.on_table, 1)
        upright = right_angled(_turned(draw(ANY_ANGLE, 1), x, z), normal)
        return origin, np.where(draw.chance(lies)[:, None, None], upright @ LYING, upright)


def _turned(angle: Array, x: Array, z: Array) -> Array:
    """The directions (N, 3) at angles (N, 1) from x to z."""
    return np.cos(angle) * x + np.sin(angle) * z


def _solid_of(draw: Draw, part: PartParameter, origin: Array, axes: Array, size: Array) -> Solids:
    """One part of each of K things, whose lengths have the factors ``size`` (K, 1)."""
    x, y = draw(part.x), draw(part.y)
    z = x if part.z is None else draw(part.z)
    half = np.stack([x, y, z], axis=-1) * size
    at_y = y if part.at_y is None else draw(part.at_y)
    at = np.stack([draw(part.at_x), at_y, draw(part.at_z)], axis=-1)
    center = origin + np.einsum("nij,nj->ni", axes, at * size)
    tilt, lean = np.deg2rad(draw(part.tilt)), np.deg2rad(draw(part.lean))
    turned = axes @ (rotation(0, tilt) @ rotation(2, lean))
    kind = np.full(draw.count, SHAPES[part.shape])
    return one_each(kind, center, turned, half, draw.chance(part.chance))


def draw_planes(
    draw: Draw, prior: PlanesParameter, person: Torsos, near: Array, palm: Array, rays: Rays
) -> Floats:
    """Depth (N, H, W) of the floor, a wall behind, and one at the side."""
    count = len(near)
    floor = near - person.up * draw(prior.floor_below, 1)
    behind = unit(prior.wall_tilt * draw.normal(3) - (0, 0, 1))
    wall = np.zeros((count, 3))
    wall[:, 2] = palm[:, 2] + draw(prior.wall_behind)
    beside = unit(across(draw.normal(3), person.up))
    beside *= -np.sign(beside[:, 2:])
    corner = palm - beside * draw(prior.beside_away, 1)
    depth = np.full((count, rays[1].shape[1], rays[0].shape[1]), NOTHING)
    for normal, point, share in (
        (person.up, floor, prior.floor),
        (behind, wall, prior.wall),
        (beside, corner, prior.beside),
    ):
        plane = plane_depth(normal, dot(normal, point), rays)
        np.minimum(depth, only(plane, draw.chance(share)), out=depth)
    return depth
