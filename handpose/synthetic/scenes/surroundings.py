"""What stands around hands: a table, things on it, in the air and in the room, floor and walls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic.scenes.directions import (
    across,
    any_direction,
    any_rotation,
    dot,
    right_angled,
    unit,
)
from handpose.synthetic.scenes.people import People, Torsos
from handpose.synthetic.scenes.prior import (
    PartParameter,
    PlanesParameter,
    Range,
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
    rng: np.random.Generator, prior: TableParameter, people: People, near: Array, rests_mm: Range
) -> Table:
    """A table below ``near`` (N, 3), or under the first hands that rest on it."""
    person = people.person
    count = len(near)
    rests = people.rests
    below = np.where(
        rng.random(count) < prior.near,
        prior.near_mm.draw(rng, count),
        prior.below_mm.draw(rng, count),
    )
    below = np.where(rests, rests_mm.draw(rng, count), below)[:, None]
    side = _turned(_any_angle(rng, count), person.right, person.face)
    level = person.up + prior.tilt * rng.normal(size=(count, 3))
    # a hand at rest lies flat: its own direction says how the table is turned
    normal = unit(np.where(rests[:, None], -people.hands[0].palmar, level))
    above = np.where(rests[:, None], people.palms[:, 0], near)
    axes = right_angled(unit(across(side, normal)), normal)
    top = above - normal * below
    center = top - prior.thickness * normal
    ahead, aside = prior.ahead.draw(rng, count, 1), prior.aside.draw(rng, count, 1)
    center = center + across(person.face * ahead + person.right * aside, normal)
    half_x, half_z = prior.half.draw(rng, count), prior.half.draw(rng, count)
    half = np.stack([half_x, np.full(count, prior.thickness), half_z], axis=-1)
    there = (rng.random(count) < prior.share) | rests
    board = one_each(np.full(count, BOX), center, axes, half, there)
    return Table(board, top, axes, there)


def draw_things(
    rng: np.random.Generator, prior: ThingsParameter, person: Torsos, near: Array, table: Table
) -> tuple[Solids, NDArray[np.int_]]:
    """Some things in each frame, each of one or several solids, M in all; and which of the prior's
    things these belong to (M,).
    """
    count = len(near)
    shares = np.array([thing.share for thing in prior.thing])
    kinds = rng.choice(len(shares), (count, prior.most), p=shares / shares.sum())
    shown = rng.random(kinds.shape) < prior.each
    shown &= (rng.random(count) < prior.share)[:, None]
    places = _Places(rng, prior, person, near, table)
    groups = []
    for k, thing in enumerate(prior.thing):
        frame, _ = np.nonzero(shown & (kinds == k))
        groups.append(_by_frame(_solids_of(places, thing, frame), frame, count))
    of = [np.full(group.kind.shape[1], k) for k, group in enumerate(groups)]
    return joined(groups), np.concatenate(of)


def _solids_of(places: _Places, thing: ThingParameter, frame: NDArray[np.int_]) -> Solids:
    """The parts of one kind of thing, K times in the given frames (K,), thing by thing."""
    size = thing.size.draw(places.rng, len(frame))
    origin, axes = places.draw(thing, frame)
    return joined([_solid_of(places.rng, part, origin, axes, size) for part in thing.part])


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


class _Places:
    """Draws where things are: about the places ``near`` (N, 3), and on the tables of N frames."""

    def __init__(
        self,
        rng: np.random.Generator,
        prior: ThingsParameter,
        person: Torsos,
        near: Array,
        table: Table,
    ) -> None:
        self.rng = rng
        self._prior = prior
        self._up, self._near, self._table = person.up, near, table

    def draw(self, thing: ThingParameter, frame: NDArray[np.int_]) -> tuple[Array, Array]:
        """Origins (K, 3) and axes (K, 3, 3) of things of one kind in the given frames (K,)."""
        # drawn for all things, though only those on tables need it, so that scenes do not change
        angle = _any_angle(self.rng, len(frame))
        if thing.stands == "ROOM":
            return self._in_room(frame)
        origin, axes = self._in_air(frame)
        if thing.stands == "AIR":
            return origin, axes
        on_table, upright = self._on_table(frame, angle, thing.lies)
        has_table = self._table.there[frame]
        origin = np.where(has_table[:, None], on_table, origin)
        return origin, np.where(has_table[:, None, None], upright, axes)

    def _in_room(self, frame: NDArray[np.int_]) -> tuple[Array, Array]:
        """Upright, anywhere."""
        count = len(frame)
        ground = self._up[frame]
        side = unit(across(any_direction(self.rng, count), ground))
        away = self._prior.in_room.draw(self.rng, count, 1)
        direction = unit(any_direction(self.rng, count) + 0.5 * side)
        return self._near[frame] + away * direction, right_angled(side, ground)

    def _in_air(self, frame: NDArray[np.int_]) -> tuple[Array, Array]:
        """Turned anyhow."""
        count = len(frame)
        direction = any_direction(self.rng, count)
        origin = self._near[frame] + direction * self._prior.in_air.draw(self.rng, count, 1)
        return origin, any_rotation(self.rng, count)

    def _on_table(self, frame: NDArray[np.int_], angle: Array, lies: float) -> tuple[Array, Array]:
        """At directions with these angles (K, 1) from the middle of the tables; a share lies."""
        count = len(frame)
        x, normal, z = np.moveaxis(self._table.axes[frame], -1, 0)
        away = self._prior.on_table.draw(self.rng, count, 1)
        origin = self._table.top[frame] + _turned(angle, x, z) * away
        upright = right_angled(_turned(_any_angle(self.rng, count), x, z), normal)
        is_lying = self.rng.random(count) < lies
        return origin, np.where(is_lying[:, None, None], upright @ LYING, upright)


def _any_angle(rng: np.random.Generator, count: int) -> Array:
    """Angles (count, 1) of all directions."""
    return rng.uniform(0, 2 * np.pi, (count, 1))


def _turned(angle: Array, x: Array, z: Array) -> Array:
    """The directions (N, 3) at angles (N, 1) from x to z."""
    return np.cos(angle) * x + np.sin(angle) * z


def _solid_of(
    rng: np.random.Generator, part: PartParameter, origin: Array, axes: Array, size: Array
) -> Solids:
    """One part of each of K things."""
    count = len(size)
    x, y = part.x.draw(rng, count), part.y.draw(rng, count)
    z = x if part.z is None else part.z.draw(rng, count)
    half = np.stack([x, y, z], axis=-1) * size[:, None]
    at_y = y if part.at_y is None else part.at_y.draw(rng, count)
    at = np.stack([part.at_x.draw(rng, count), at_y, part.at_z.draw(rng, count)], axis=-1)
    center = origin + np.einsum("nij,nj->ni", axes, at * size[:, None])
    tilt, lean = (np.deg2rad(angle.draw(rng, count)) for angle in (part.tilt, part.lean))
    turned = axes @ (rotation(0, tilt) @ rotation(2, lean))
    there = rng.random(count) < part.chance
    return one_each(np.full(count, SHAPES[part.shape]), center, turned, half, there)


def draw_planes(
    rng: np.random.Generator,
    prior: PlanesParameter,
    person: Torsos,
    near: Array,
    palm: Array,
    rays: Rays,
) -> Floats:
    """Depth (N, H, W) of the floor, a wall behind, and one at the side."""
    count = len(near)
    floor = near - person.up * prior.floor_below.draw(rng, count, 1)
    behind = unit(prior.wall_tilt * rng.normal(size=(count, 3)) - (0, 0, 1))
    wall = np.zeros((count, 3))
    wall[:, 2] = palm[:, 2] + prior.wall_behind.draw(rng, count)
    beside = unit(across(rng.normal(size=(count, 3)), person.up))
    beside *= -np.sign(beside[:, 2:])
    corner = palm - beside * prior.beside_away.draw(rng, count, 1)
    depth = np.full((count, rays[1].shape[1], rays[0].shape[1]), NOTHING)
    for normal, point, share in (
        (person.up, floor, prior.floor),
        (behind, wall, prior.wall),
        (beside, corner, prior.beside),
    ):
        plane = plane_depth(normal, dot(normal, point), rays)
        np.minimum(depth, only(plane, rng.random(count) < share), out=depth)
    return depth
