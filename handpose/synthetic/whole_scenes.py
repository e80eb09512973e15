"""Whole depth frames of ordinary scenes, with labels: people with one or two hands, tables,
things, walls.

A scene is drawn from a hand outwards. The hand lies anywhere in the frame, turned anyhow; its
forearm leads to the person's upper arm, shoulders, head, trunk and legs, and these to the other
hand. The camera is on the person's head, or anywhere around. The table may be nearer than the
hands; things stand on it, in the room, hang in the air, or are held. How often, how large and where
is the scene prior's (``scenes.prior``).

Frames have a focal length of about ``FOCAL_PX``. A block of ``SCENES_PER_BLOCK`` scenes depends on
the seed, the split and its number alone. Axes are the camera's: x right, y up, z away, in mm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic import prior_file
from handpose.synthetic.generator import Split, rng_of
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH, draw_cameras, slopes_of
from handpose.synthetic.scenes.hands import draw_held
from handpose.synthetic.scenes.people import People, draw_arm, draw_body, draw_people
from handpose.synthetic.scenes.prior import LightParameter, ScenePrior
from handpose.synthetic.scenes.solids import (
    NOTHING,
    Layer,
    Rays,
    capsule_depth,
    nearest,
    one,
    only,
    solid_layer,
)
from handpose.synthetic.scenes.surroundings import draw_planes, draw_table, draw_things
from handpose.synthetic.sensor import measure_frame
from netlib.blob import Array

OTHER, HAND, PERSON = 0, 1, 2  # classes of pixels
SCENES_PER_BLOCK = 16  # scenes that share a random generator
STREAM = 2  # apart from the random numbers of hands and of places
SEEN, SEEN_PX, FARTHEST_MM = 0.3, 25, 1800.0  # a hand counts if as much of it is visible and read
READ = 0.35  # of what is visible
TOLERANCE_MM = 4.0  # by which a hand wins against its own forearm, whose end covers the wrist
NEARER = 0.7  # share of surroundings about the first hand, not the second
# numbers of objects in a frame; those from THINGS on are solids of things
GROUPS = ("nothing", "hand", "person", "table", "planes", "held", "held")
THINGS = len(GROUPS)
HAND_OBJECT, PERSON_OBJECT, TABLE_OBJECT, PLANE_OBJECT, HELD_OBJECT = range(1, 6)


class Scenes(NamedTuple):
    """N frames.

    Hands that are hidden, cut off or hardly read are ``doubtful``: neither right nor wrong to find.

    depth      (N, HEIGHT, WIDTH) mm, 0 where nothing was read
    classes    (N, HEIGHT, WIDTH) OTHER, HAND or PERSON
    which      (N, HEIGHT, WIDTH) 1 or 2 at the pixels of the first or second hand, else 0
    what       (N, HEIGHT, WIDTH) what is shown: an index of ``SceneGenerator.names``
    middle     (N, 2, 3) mm, the mean of each hand's joints without the wrist
    middle_px  (N, 2, 2) its column and row
    present    (N, 2) whether the hand is to be found
    doubtful   (N, 2)
    slopes     (N, HEIGHT, WIDTH, 2) x / z and y / z of the rays
    """

    depth: Floats
    classes: NDArray[np.int8]
    which: NDArray[np.int8]
    what: NDArray[np.int16]
    middle: Array
    middle_px: Array
    present: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]
    slopes: Floats


class Clean(NamedTuple):
    """Scenes without errors of a sensor (depth infinite where there is nothing).

    focal     (N,) px
    reflects  (N, HEIGHT, WIDTH) the part of the light that the surfaces send back
    """

    scenes: Scenes
    focal: Array
    reflects: Floats


class SceneGenerator:
    """Draws scenes for a seed and a split, block by block.

    names  of what the scenes show
    """

    def __init__(
        self, seed: int = 0, split: Split = "train", prior: ScenePrior | None = None
    ) -> None:
        self.seed = seed
        self.split = split
        self.prior = prior or scene_prior.load()
        self.sampler = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))
        self.names = (*GROUPS[:-1], *(thing.name for thing in self.prior.things.thing))

    def block(self, number: int) -> Scenes:
        """Scenes ``number * SCENES_PER_BLOCK`` and following, as a camera measures them."""
        rng = rng_of(self.seed, self.split, number, STREAM)
        scenes, focal, reflects = draw_scenes(rng, self.prior, self.sampler, SCENES_PER_BLOCK)
        depth = np.stack(
            [
                measure_frame(rng, *scene)
                for scene in zip(scenes.depth, scenes.which > 0, focal, reflects)
            ]
        )
        return _judged(scenes._replace(depth=depth))


def draw_scenes(
    rng: np.random.Generator, prior: ScenePrior, sampler: BodySampler, count: int
) -> Clean:
    """``count`` scenes."""
    cameras = draw_cameras(rng, prior.view, count)
    rays = cameras.rays()
    people = draw_people(rng, prior, sampler, cameras)
    hands = [
        only(capsule_depth(hand.own, rays), there)
        for hand, there in zip(people.hands, people.there.T)
    ]
    hand = np.minimum(*hands)
    solids, of = _surroundings(rng, prior, people, rays, hands[0])
    others = [one(_arms(rng, prior, people, rays), PERSON_OBJECT), *solids]
    behind = nearest(others)
    far = _farthest(rng, prior.light, people.palms[:, 0])[:, None, None]
    is_hand = np.isfinite(hand) & (hand <= behind.depth + TOLERANCE_MM) & (hand < far)
    depth = np.minimum(hand, behind.depth)
    depth = np.where(depth < far, depth, NOTHING)
    number = np.where(is_hand, HAND_OBJECT, behind.number)
    number[np.isinf(depth)] = 0
    what_of_number = np.array([*range(THINGS - 1), THINGS - 2, *(THINGS - 1 + of)])
    what = what_of_number[number]
    classes = np.select([is_hand, what == PERSON_OBJECT], [HAND, PERSON], OTHER)
    middles = np.stack([hand.middle for hand in people.hands], axis=1)
    seen = [_mostly_seen(own, is_hand & (own == hand)) for own in hands]
    nearer = np.where(hands[1] < hands[0], 2, 1)
    which = np.where(is_hand, nearer, 0)
    scenes = Scenes(
        depth=depth,
        classes=classes.astype(np.int8),
        which=which.astype(np.int8),
        what=what.astype(np.int16),
        middle=middles,
        middle_px=cameras.pixels(middles),
        present=people.there & np.stack(seen, axis=1),
        doubtful=people.there,
        slopes=slopes_of(rays),
    )
    light = _light(rng, prior.light, count, THINGS + len(of))
    return Clean(scenes, cameras.focal, light[np.arange(count)[:, None, None], number])


def _arms(rng: np.random.Generator, prior: ScenePrior, people: People, rays: Rays) -> Floats:
    """Depth of the arms; some second ones are there without their hand."""
    count = len(people.palms)
    alone = rng.random(count) < prior.arm.without_hand
    shown = people.there | np.stack([np.zeros(count, bool), alone], axis=1)
    arms = [
        draw_arm(rng, prior.arm, hand, people.person, there)
        for hand, there in zip(people.hands, shown.T)
    ]
    return np.minimum(*(capsule_depth(arm, rays) for arm in arms))


def _surroundings(
    rng: np.random.Generator, prior: ScenePrior, people: People, rays: Rays, first: Floats
) -> tuple[list[Layer], NDArray[np.int_]]:
    """What is there besides hands and arms, without what hides the first hands, whose depth
    is given; and to which of the prior's things the solids of things belong.
    """
    person, palms, count = people.person, people.palms, len(people.palms)
    is_first = rng.random((count, 1)) < NEARER
    near = np.where(is_first, palms[:, 0], palms[:, 1])
    body = capsule_depth(draw_body(rng, prior.body, person), rays)
    table = draw_table(rng, prior.table, people, near, prior.hands.rests_mm)
    things, of = draw_things(rng, prior.things, person, near, table)
    planes = draw_planes(rng, prior.planes, person, near, palms[:, 0], rays)
    held = draw_held(rng, prior.held, people.hands[0], palms[:, 0], people.there[:, 0])
    with_body = rng.random(count) < prior.body.share
    layers = {
        "body": one(body, PERSON_OBJECT).only(with_body),
        "table": solid_layer(table.board, TABLE_OBJECT, rays),
        "things": solid_layer(things, THINGS, rays),
        "planes": one(planes, PLANE_OBJECT),
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


def _farthest(rng: np.random.Generator, light: LightParameter, palm: Array) -> Array:
    """The depth (N,) in mm from which nothing is read: some cameras end a little behind the
    hand.
    """
    count = len(palm)
    behind = light.range_behind.draw(rng, count)
    return np.where(rng.random(count) < light.range, palm[:, 2] + behind, np.inf)


def _light(rng: np.random.Generator, light: LightParameter, count: int, objects: int) -> Floats:
    """The part of the light (N, objects) that objects send back; hands send all."""
    reflects = light.reflects.draw(rng, count, objects)
    reflects[:, PERSON_OBJECT] = light.people_reflect.draw(rng, count)
    reflects[:, HAND_OBJECT] = 1.0
    return reflects.astype(np.float32)


def _mostly_seen(whole: Floats, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether enough (N,) of hands with depths (N, H, W) is seen."""
    return seen.sum((1, 2)) > SEEN * np.maximum(np.isfinite(whole).sum((1, 2)), 1)


def _pixels_of_hands(which: Array) -> Array:
    """The number of pixels (N, 2) of both hands, from which hand each pixel (N, H, W) is of."""
    return np.stack([(which == hand).sum((1, 2)) for hand in (1, 2)], axis=1)


def _judged(scenes: Scenes) -> Scenes:
    """The scenes with those hands present that are read well enough too, and the
    others doubtful.
    """
    u, v = np.moveaxis(scenes.middle_px, -1, 0)
    z = scenes.middle[..., 2]
    inside = (u > 1) & (u < WIDTH - 2) & (v > 1) & (v < HEIGHT - 2)
    seen = _pixels_of_hands(scenes.which)
    read = _pixels_of_hands(np.where(scenes.depth > 0, scenes.which, 0))
    is_read = (read > SEEN_PX) & (read > READ * seen)
    present = scenes.present & inside & (z < FARTHEST_MM) & is_read
    return scenes._replace(present=present, doubtful=scenes.doubtful & ~present & (seen > 0))
