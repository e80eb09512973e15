"""What stands around hands: a table, things on it, in the air and in the room, floor and walls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic.scenes.directions import across, any_direction, any_rotation, dot, unit
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
    only,
    plane_depth,
)
from netlib.blob import Array


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
    count, rests = len(near), people.rests
    below = np.where(
        rng.random(count) < prior.near,
        prior.near_mm.draw(rng, count),
        prior.below_mm.draw(rng, count),
    )
    below = np.where(rests, rests_mm.draw(rng, count), below)[:, None]
    yaw = rng.uniform(0, 2 * np.pi, (count, 1))
    level = person.up + prior.tilt * rng.normal(size=(count, 3))
    # a hand at rest lies flat: its own direction says how the table is turned
    normal = unit(np.where(rests[:, None], -people.hands[0].palmar, level))
    above = np.where(rests[:, None], people.palms[:, 0], near)
    along = unit(across(person.right * np.cos(yaw) + person.face * np.sin(yaw), normal))
    axes = np.stack([along, normal, np.cross(along, normal)], axis=-1)
    top = above - normal * below
    center = top - prior.thickness * normal
    ahead, aside = prior.ahead.draw(rng, count, 1), prior.aside.draw(rng, count, 1)
    center = center + across(person.face * ahead + person.right * aside, normal)
    half_x, half_z = prior.half.draw(rng, count), prior.half.draw(rng, count)
    half = np.stack([half_x, np.full(count, prior.thickness), half_z], axis=-1)
    there = (rng.random(count) < prior.share) | rests
    kind = np.full((count, 1), BOX)
    board = Solids(kind, center[:, None], axes[:, None], half[:, None], there[:, None])
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
    parts = [
        _solids_of(rng, prior, thing, person, near, table, shown & (kinds == k))
        for k, thing in enumerate(prior.thing)
    ]
    of = [np.full(part.kind.shape[1], k) for k, part in enumerate(parts)]
    return joined(parts), np.concatenate(of)


def _solids_of(
    rng: np.random.Generator,
    prior: ThingsParameter,
    thing: ThingParameter,
    person: Torsos,
    near: Array,
    table: Table,
    shown: NDArray[np.bool_],
) -> Solids:
    """The parts of one kind of thing, at those of M places of N frames where it is shown."""
    n, _ = np.nonzero(shown)
    size = thing.size.draw(rng, len(n))
    origin, axes = _placed(rng, prior, thing, person, near, table, n)
    parts = [_solid_of(rng, part, origin, axes, size) for part in thing.part]
    return _by_frame(parts, n, len(shown))


def _by_frame(
    parts: list[tuple[NDArray[np.int_], Array, Array, Array, NDArray[np.bool_]]],
    frame: NDArray[np.int_],
    count: int,
) -> Solids:
    """Solids of K things, which are in the given frames (K,), frame by frame."""
    kind, center, axes, half, there = (np.stack(values, axis=1) for values in zip(*parts))
    many = np.bincount(frame, minlength=count)
    most, each = int(many.max(initial=0)), kind.shape[1]
    first = np.cumsum(many) - many
    slot = np.arange(len(frame)) - first[frame]

    def spread(values: Array) -> Array:
        out = np.zeros((count, most, *values.shape[1:]), values.dtype)
        out[frame, slot] = values
        return out.reshape(count, most * each, *values.shape[2:])

    return Solids(*map(spread, (kind, center, axes, half, there)))


def _placed(
    rng: np.random.Generator,
    prior: ThingsParameter,
    thing: ThingParameter,
    person: Torsos,
    near: Array,
    table: Table,
    n: NDArray[np.int_],
) -> tuple[Array, Array]:
    """Origins (K, 3) and axes (K, 3, 3) of things of one kind in the frames ``n`` (K,)."""
    count = len(n)
    yaw = rng.uniform(0, 2 * np.pi, (count, 1))
    if thing.stands == "ROOM":
        ground = person.up[n]
        side = unit(across(any_direction(rng, count), ground))
        away = prior.in_room.draw(rng, count, 1)
        origin = near[n] + away * unit(any_direction(rng, count) + 0.5 * side)
        axes = np.stack([side, ground, np.cross(side, ground)], axis=-1)
        return origin, axes
    origin = near[n] + any_direction(rng, count) * prior.in_air.draw(rng, count, 1)
    axes = any_rotation(rng, count)
    if thing.stands == "AIR":
        return origin, axes
    on = table.there[n][:, None]
    x, normal, z = np.moveaxis(table.axes[n], -1, 0)
    flat = np.cos(yaw) * x + np.sin(yaw) * z
    on_table = table.top[n] + flat * prior.on_table.draw(rng, count, 1)
    turn = rng.uniform(0, 2 * np.pi, (count, 1))
    front = np.cos(turn) * x + np.sin(turn) * z
    upright = np.stack([front, normal, np.cross(front, normal)], axis=-1)
    lies = rng.random(count) < thing.lies
    lying = upright[..., [1, 0, 2]] * (1, 1, -1)
    upright = np.where(lies[:, None, None], lying, upright)
    return np.where(on, on_table, origin), np.where(on[..., None], upright, axes)


def _solid_of(
    rng: np.random.Generator, part: PartParameter, origin: Array, axes: Array, size: Array
) -> tuple[NDArray[np.int_], Array, Array, Array, NDArray[np.bool_]]:
    """One part of K things: the values of ``Solids``."""
    count = len(size)
    x, y = part.x.draw(rng, count), part.y.draw(rng, count)
    z = x if part.z is None else part.z.draw(rng, count)
    half = np.stack([x, y, z], axis=-1) * size[:, None]
    at_y = y if part.at_y is None else part.at_y.draw(rng, count)
    at = np.stack([part.at_x.draw(rng, count), at_y, part.at_z.draw(rng, count)], axis=-1)
    center = origin + np.einsum("nij,nj->ni", axes, at * size[:, None])
    turned = axes @ _tilted(part.tilt.draw(rng, count), part.lean.draw(rng, count))
    there = rng.random(count) < part.chance
    return np.full(count, SHAPES[part.shape]), center, turned, half, there


def _tilted(tilt: Array, lean: Array) -> Array:
    """Rotations (K, 3, 3) about x by ``tilt`` after those about z by ``lean``, degrees (K,)."""
    a, b = np.deg2rad(tilt), np.deg2rad(lean)
    zero, one = np.zeros_like(a), np.ones_like(a)
    cos, sin = np.cos(a), np.sin(a)
    about_x = [[one, zero, zero], [zero, cos, -sin], [zero, sin, cos]]
    cos, sin = np.cos(b), np.sin(b)
    about_z = [[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]
    return np.einsum("ijn,jkn->nik", about_x, about_z)


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
