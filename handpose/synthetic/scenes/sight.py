"""What rays meet in a scene: the nearest of hands, arms, bodies, table, things, floor and walls.

The surroundings are drawn around the people (``people``), and what would hide too much of the first
hand is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.hands import draw_held
from handpose.synthetic.scenes.people import People, draw_arm, draw_body
from handpose.synthetic.scenes.prior import LightParameter, ScenePrior
from handpose.synthetic.scenes.solids import (
    NOTHING,
    Layer,
    Rays,
    capsule_depth,
    layer_of,
    nearest,
    only,
    solid_layer,
)
from handpose.synthetic.scenes.surroundings import draw_planes, draw_table, draw_things
from netlib.blob import Array

TOLERANCE_MM = 4.0  # by which a hand wins against its own forearm, whose end covers the wrist
NEARER = 0.7  # share of surroundings about the first hand, not the second
# numbers of objects in a view; those from THINGS on are solids of things
GROUPS = ("nothing", "hand", "person", "table", "planes", "held", "held")
THINGS = len(GROUPS)
HAND_OBJECT, PERSON_OBJECT, TABLE_OBJECT, PLANE_OBJECT, HELD_OBJECT = range(1, 6)


class Sight(NamedTuple):
    """What the rays of N views meet, without errors of a sensor.

    depth     (N, H, W) mm, infinite where there is nothing
    number    (N, H, W) of the object in its view, 0 for none
    of        what the objects from ``THINGS`` on show: numbers of the prior's things
    which     (N, H, W) 1 or 2 at the pixels of the first or second hand, else 0
    share     (N, 2) the part of each hand that is seen, of what the view could show of it
    reflects  (N, H, W) the part of the light that the surfaces send back
    """

    depth: Floats
    number: NDArray[np.int16]
    of: NDArray[np.int_]
    which: NDArray[np.int8]
    share: Array
    reflects: Floats


def sight_of(draw: Draw, prior: ScenePrior, people: People, rays: Rays) -> Sight:
    """People and what is around them, along rays."""
    hands = [
        only(capsule_depth(hand.own, rays), there)
        for hand, there in zip(people.hands, people.there.T)
    ]
    hand = np.minimum(*hands)
    solids, of = _surroundings(draw, prior, people, rays, hands[0])
    arms = layer_of(_arms(draw, prior, people, rays), PERSON_OBJECT)
    behind = nearest([arms, *solids])
    far = _farthest(draw, prior.light, people.palms[:, 0])[:, None, None]
    is_hand = np.isfinite(hand) & (hand <= behind.depth + TOLERANCE_MM) & (hand < far)
    depth = np.minimum(hand, behind.depth)
    depth = np.where(depth < far, depth, NOTHING)
    number = np.where(is_hand, HAND_OBJECT, behind.number)
    number[np.isinf(depth)] = 0
    shares = [_seen_share(own, is_hand & (own == hand)) for own in hands]
    nearer = np.where(hands[1] < hands[0], 2, 1)
    which = np.where(is_hand, nearer, 0).astype(np.int8)
    light = _light(draw, prior.light, THINGS + len(of))
    view = np.arange(len(depth))[:, None, None]
    reflects = light[view, number]
    return Sight(depth, number, of, which, np.stack(shares, axis=1), reflects)


def _arms(draw: Draw, prior: ScenePrior, people: People, rays: Rays) -> Floats:
    """Depth of the arms; some second ones are there without their hand."""
    alone = draw.chance(prior.arm.without_hand)
    shown = people.there | np.stack([np.zeros_like(alone), alone], axis=1)
    arms = [
        draw_arm(draw, prior.arm, hand, people.person, there)
        for hand, there in zip(people.hands, shown.T)
    ]
    return np.minimum(*(capsule_depth(arm, rays) for arm in arms))


def _surroundings(
    draw: Draw, prior: ScenePrior, people: People, rays: Rays, first: Floats
) -> tuple[list[Layer], NDArray[np.int_]]:
    """What is there besides hands and arms, without what hides the first hands, whose depth
    is given; and to which of the prior's things the solids of things belong.
    """
    person, palms = people.person, people.palms
    is_first = draw.chance(NEARER)[:, None]
    near = np.where(is_first, palms[:, 0], palms[:, 1])
    body = capsule_depth(draw_body(draw, prior.body, person), rays)
    table = draw_table(draw, prior.table, people, near, prior.hands.rests_mm)
    things, of = draw_things(draw, prior.things, person, near, table)
    planes = draw_planes(draw, prior.planes, person, near, palms[:, 0], rays)
    held = draw_held(draw, prior.held, people.hands[0], palms[:, 0], people.there[:, 0])
    with_body = draw.chance(prior.body.share)
    layers = {
        "body": layer_of(body, PERSON_OBJECT).only(with_body),
        "table": solid_layer(table.board, TABLE_OBJECT, rays),
        "things": solid_layer(things, THINGS, rays),
        "planes": layer_of(planes, PLANE_OBJECT),
    }
    kept = [
        layer.only(_hidden(layer.depth, first) <= getattr(prior.hidden, name))
        for name, layer in layers.items()
    ]
    return [*kept, solid_layer(held, HELD_OBJECT, rays)], of


def _hidden(depth: Floats, hand: Floats) -> Array:
    """The part (N,) of hands that something nearer hides."""
    own = np.isfinite(hand)
    hides = ((depth < hand) & own).sum((1, 2))
    return hides / np.maximum(own.sum((1, 2)), 1)


def _farthest(draw: Draw, light: LightParameter, palm: Array) -> Array:
    """The depth (N,) in mm from which nothing is read: some cameras end a little behind the
    hand.
    """
    behind = draw(light.range_behind)
    return np.where(draw.chance(light.range), palm[:, 2] + behind, np.inf)


def _light(draw: Draw, light: LightParameter, objects: int) -> Floats:
    """The part of the light (N, objects) that objects send back; hands send all."""
    reflects = draw(light.reflects, objects)
    reflects[:, PERSON_OBJECT] = draw(light.people_reflect)
    reflects[:, HAND_OBJECT] = 1.0
    return reflects.astype(np.float32)


def _seen_share(whole: Floats, seen: NDArray[np.bool_]) -> Array:
    """The part (N,) that is seen of hands with depths (N, H, W)."""
    return seen.sum((1, 2)) / np.maximum(np.isfinite(whole).sum((1, 2)), 1)
