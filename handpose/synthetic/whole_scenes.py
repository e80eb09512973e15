"""Whole depth frames of ordinary scenes, with labels: people with one or two hands, tables,
objects, walls.

A scene is drawn from a hand outwards. The hand lies anywhere in the frame, turned anyhow; its
forearm leads to the person's upper arm, shoulders, head, trunk and legs, and these to the other
hand. The camera is on the person's head, or anywhere around. The table may be nearer than the
hands; objects stand on it, hang in the air, or are held.

Frames have a focal length of about ``FOCAL_PX``. A block of ``BLOCK`` scenes depends on the seed,
the split and its number alone. Axes are the camera's: x right, y up, z away, in mm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules, in_front, render
from handpose.estimate.finder import FOCAL_PX
from handpose.frames.cameras import Floats
from handpose.synthetic import prior_file
from handpose.synthetic.generator import Split, numbers_of
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.sensor import measure_frame
from handpose.synthetic.surface_prior import SurfacePrior, draw_capsules
from netlib.blob import Array

OTHER, HAND, PERSON = 0, 1, 2  # classes of pixels
HEIGHT, WIDTH = 128, 160
BLOCK = 16  # scenes that share a random generator
STREAM = 2  # apart from the random numbers of hands and of places

# share of the first hand; else left out
MOST_HIDDEN = {"person": 0.35, "table": 0.5, "planes": 0.35, "things": 0.5}
SEEN, SEEN_PX, FARTHEST_MM = 0.3, 25, 1800.0  # a hand counts if as much of it is visible and read
TOLERANCE_MM = 4.0  # by which a hand wins against its own forearm, whose end covers the wrist
TRIALS = 10  # arrangements of an arm, of which the best is taken
ARM_MM, SHOULDER_MM = 290.0, 170.0  # upper arm; from the middle of the shoulders to one
NEAR_MM = 60.0  # solids that begin nearer are left out
SURFACE = SurfacePrior(
    thickness_std=0.1, trunk_std=0.08, radius_std=0.06, offsets=(0.4, 1.6), towards_camera=1.0
)
BODY = (  # right, up and forward of the middle of the shoulders: from, to; both radii
    ((-60, -60, 0), (-60, -420, 10), 95, 110),
    ((60, -60, 0), (60, -420, 10), 95, 110),
    ((0, -120, 20), (0, -430, 30), 110, 125),
    ((-140, -15, 0), (140, -15, 0), 65, 65),
    ((0, 40, 15), (0, 150, 25), 58, 55),
    ((0, 190, 30), (0, 255, 20), 85, 92),
)
BOX, CYLINDER, ELLIPSOID = 0, 1, 2


class Scenes(NamedTuple):
    """N frames.

    Hands that are hidden, cut off or hardly read are ``doubtful``: neither right nor wrong to find.

    depth      (N, HEIGHT, WIDTH) mm, 0 where nothing was read
    classes    (N, HEIGHT, WIDTH) OTHER, HAND or PERSON
    which      (N, HEIGHT, WIDTH) 1 or 2 at the pixels of the first or second hand, else 0
    middle     (N, 2, 3) mm, the mean of each hand's joints without the wrist
    middle_px  (N, 2, 2) its column and row
    side       (N, 2) 1 for a right hand, -1 for a left one
    present    (N, 2) whether the hand is to be found
    doubtful   (N, 2)
    slopes     (N, HEIGHT, WIDTH, 2) x / z and y / z of the rays
    """

    depth: Floats
    classes: NDArray[np.int8]
    which: NDArray[np.int8]
    middle: Array
    middle_px: Array
    side: Array
    present: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]
    slopes: Floats


class Solids(NamedTuple):
    """M boxes, cylinders or ellipsoids in each of N frames; ``shown`` (N, M) are there."""

    kind: NDArray[np.int_]  # (N, M)
    center: Array  # (N, M, 3)
    axes: Array  # (N, M, 3, 3) columns; a cylinder's length lies along the second
    half: Array  # (N, M, 3) half lengths along the axes
    shown: NDArray[np.bool_]


class Person(NamedTuple):
    """Directions and places of N people: (N, 3) each, and the size (N, 1)."""

    up: Array
    face: Array
    right: Array
    middle: Array  # between the shoulders
    size: Array

    def shoulder(self, side: Array) -> Array:
        """The shoulders of the given sides (N,)."""
        return self.middle + side[:, None] * self.right * SHOULDER_MM * self.size


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


class Cameras(NamedTuple):
    """The cameras of N frames: focal lengths and principal points in px, (N,) each."""

    focal: Array
    u0: Array
    v0: Array

    def rays(self) -> tuple[Floats, Floats]:
        """Slopes of the columns (N, WIDTH), and of the rows (N, HEIGHT), downwards."""
        x = (np.arange(WIDTH) - self.u0[:, None]) / self.focal[:, None]
        y = (np.arange(HEIGHT) - self.v0[:, None]) / self.focal[:, None]
        return x.astype(np.float32), y.astype(np.float32)

    def pixels(self, xyz: Array) -> Array:
        """Columns and rows (N, ..., 2) of points (N, ..., 3)."""
        z = np.maximum(xyz[..., 2], 50)
        f, u0, v0 = (value.reshape(-1, *[1] * (xyz.ndim - 2)) for value in self)
        return np.stack([u0 + f * xyz[..., 0] / z, v0 - f * xyz[..., 1] / z], axis=-1)

    def at(self, u: Array, v: Array, z: Array) -> Array:
        """The points (N, 3) at pixels and depths (N,)."""
        return np.stack(
            [(u - self.u0) / self.focal * z, (self.v0 - v) / self.focal * z, z], axis=-1
        )


class SceneGenerator:
    """Draws scenes for a seed and a split, block by block."""

    def __init__(self, seed: int = 0, split: Split = "train") -> None:
        self.seed, self.split = seed, split
        self.sampler = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))

    def block(self, number: int) -> Scenes:
        """Scenes ``number * BLOCK`` and following, as a camera measures them."""
        rng = numbers_of(self.seed, self.split, number, STREAM)
        scenes, focal = draw_scenes(rng, self.sampler, BLOCK)
        depth = np.stack(
            [measure_frame(rng, *scene) for scene in zip(scenes.depth, scenes.which > 0, focal)]
        )
        return _judged(scenes._replace(depth=depth))


def draw_scenes(rng: np.random.Generator, sampler: BodySampler, count: int) -> tuple[Scenes, Array]:
    """Scenes without errors of a sensor (depth infinite where there is nothing), and their
    focal lengths (N,).
    """
    cameras = Cameras(
        FOCAL_PX * rng.uniform(0.93, 1.07, count),
        WIDTH / 2 + rng.uniform(-60, 60, count),
        HEIGHT / 2 + rng.uniform(-50, 50, count),
    )
    first, second, person, palms, shown = _people(rng, sampler, cameras)
    rays = cameras.rays()
    hands = [_only(_render(hand.own, rays), there) for hand, there in zip((first, second), shown.T)]
    arms = [
        _arm(rng, hand, person, there | (rng.random(count) < extra))
        for hand, there, extra in zip((first, second), shown.T, (0.0, 0.3))
    ]
    arm = np.minimum(*(_render(one, rays) for one in arms))
    body = _only(_render(_body(rng, person), rays), rng.random(count) < 0.75)
    near = np.where((rng.random(count) < 0.7)[:, None], palms[:, 0], palms[:, 1])
    table, top, axes = _table(rng, person, near)
    with_table = rng.random(count) < 0.6
    things, sticks = _things(rng, near, top, axes, with_table)
    clutter = np.minimum(_solid_depth(things, rays), _render(sticks, rays))
    groups = {
        "person": body,
        "table": _only(_solid_depth(table, rays), with_table),
        "things": _only(clutter, rng.random(count) < 0.8),
        "planes": _planes(rng, person, near, palms[:, 0], rays),
    }
    own = np.isfinite(hands[0])
    for name, most in MOST_HIDDEN.items():
        hidden = ((groups[name] < hands[0]) & own).sum((1, 2)) / np.maximum(own.sum((1, 2)), 1)
        groups[name] = _only(groups[name], hidden <= most)
    held = _solid_depth(_held(rng, first, palms[:, 0], shown[:, 0]), rays)
    people = np.minimum(arm, groups["person"])
    hand = np.minimum(*hands)
    beyond = _solid_depth(_beyond(rng, near), rays)
    depth = np.minimum.reduce(
        [hand, people, held, groups["table"], groups["things"], groups["planes"], beyond]
    )
    depth = np.where(depth < _range(rng, palms[:, 0])[:, None, None], depth, np.float32(np.inf))
    is_hand = np.isfinite(hand) & (hand <= depth + TOLERANCE_MM)
    is_person = np.isfinite(depth) & (people <= depth)
    x, y = rays
    middles = np.stack([first.middle, second.middle], axis=1)
    scenes = Scenes(
        depth=depth,
        classes=np.select([is_hand, is_person], [HAND, PERSON], OTHER).astype(np.int8),
        which=np.where(is_hand, np.where(hands[1] < hands[0], 2, 1), 0).astype(np.int8),
        middle=middles,
        middle_px=cameras.pixels(middles),
        side=np.stack([first.side, second.side], axis=1),
        present=shown
        & np.stack([_mostly_seen(one, is_hand & (one == hand)) for one in hands], axis=1),
        doubtful=shown,
        slopes=np.stack(np.broadcast_arrays(x[:, None, :], -y[:, :, None]), axis=-1),
    )
    return scenes, cameras.focal


# --------------------------------------------------------------------------------- hands and people


def _draw_hands(rng: np.random.Generator, sampler: BodySampler, side: Array) -> Hands:
    """Hands of the given sides about the middles of their palms."""
    surface, count = sampler.surface, len(side)
    bodies, unit = sampler.draw(rng, count), sampler.cube_mm / 2
    far = np.tile((0.0, 0.0, 10 * sampler.cube_mm), (count, 1))  # so that none is cut at the camera
    whole = draw_capsules(
        rng, SURFACE, surface, bodies.inputs, bodies.bones, bodies.scale, unit, far
    )
    row = {name: n for n, name in enumerate(sampler.skeleton.joint_names)}
    mirror = np.stack([side, np.ones(count), np.ones(count)], axis=1)
    palm = bodies.joints[:, row["palm"]] * unit
    whole = whole.moved(-far - palm).mirrored(mirror)
    joints = (bodies.joints * unit - palm[:, None]) * mirror[:, None]
    wrist, index, little, middle = (
        joints[:, row[name]] for name in ("wrist_middle", "index_mcp", "little_mcp", "middle_mcp")
    )
    palmar = -side[:, None] * _unit(np.cross(index - wrist, little - wrist))
    limb = int(np.flatnonzero(surface.limbs)[0])
    return Hands(
        whole.chosen(~surface.limbs),
        whole.a[:, limb],
        whole.b[:, limb],
        np.stack([whole.radius_a[:, limb], whole.radius_b[:, limb]], axis=1),
        palmar,
        _unit(index - little),
        _unit(middle - wrist),
        joints[:, [row[f"{f}_tip"] for f in ("index", "middle", "ring", "little")]],
        joints[:, [not name.startswith("wrist") for name in row]].mean(1),
        bodies.scale,
        side,
    )


def _people(
    rng: np.random.Generator, sampler: BodySampler, cameras: Cameras
) -> tuple[Hands, Hands, Person, Array, NDArray[np.bool_]]:
    """Two placed hands, who they belong to, the palms (N, 2, 3), and which of the hands
    are there (N, 2).
    """
    count = len(cameras.focal)
    z = np.exp(rng.uniform(np.log(230), np.log(1600), count))
    place = cameras.at(rng.uniform(6, WIDTH - 6, count), rng.uniform(6, HEIGHT - 6, count), z)
    side = rng.choice([-1.0, 1.0], count)
    first = _draw_hands(rng, sampler, side)
    size = np.clip(first.scale / 0.92, 0.8, 1.2)[:, None]
    mode = rng.random(count)
    on_head, facing = mode < 0.3, mode > 0.6
    up = _upright(rng, on_head)
    ahead = np.array([0.0, 0.0, 1.0])
    wearer_face = _unit(_across(ahead + 0.25 * rng.normal(size=(count, 3)) - 0.3 * up, up))
    wearer_right = np.cross(up, wearer_face)
    wearer_middle = (
        -up * rng.uniform(60, 320, (count, 1))
        + wearer_face * rng.uniform(-150, 60, (count, 1))
        + wearer_right * rng.uniform(-100, 100, (count, 1))
    )
    wearer = Person(up, wearer_face, wearer_right, wearer_middle, size)

    turns = _rotations(rng, count, TRIALS)
    forearm = np.einsum("nkij,nj->nki", turns, _unit(first.elbow - first.wrist))
    away = (forearm * _unit(place)[:, None]).sum(-1)  # negative: the elbow is nearer than the hand
    score = rng.random((count, TRIALS)) - 3 * (away < -0.85)
    elbows = place[:, None] + np.einsum("nkij,nj->nki", turns, first.elbow)
    reach = np.linalg.norm(elbows - wearer.shoulder(side)[:, None], axis=-1) - ARM_MM * size
    score -= on_head[:, None] * np.clip(np.abs(reach) / 120, 0, 4)
    score += facing[:, None] * ((away > 0) - 0.5 * (forearm * up[:, None]).sum(-1))
    first = first.placed(turns[np.arange(count), score.argmax(1)], place)

    fore = _unit(first.wrist - first.elbow)
    face = np.where(
        on_head[:, None], wearer_face, _unit(_across(fore + 0.6 * rng.normal(size=(count, 3)), up))
    )
    right = np.cross(up, face)
    upper = _unit(
        -face * rng.uniform(-0.2, 1, (count, 1))
        + up * rng.uniform(-0.3, 1.1, (count, 1))
        - side[:, None] * right * rng.uniform(-0.3, 0.6, (count, 1))
        + 0.3 * rng.normal(size=(count, 3))
    )
    shoulder = np.where(
        on_head[:, None], wearer.shoulder(side), first.elbow + ARM_MM * size * upper
    )
    person = Person(up, face, right, shoulder - side[:, None] * right * SHOULDER_MM * size, size)
    second, other_place = _second(rng, sampler, cameras, person, place, side)
    some = rng.random(count) >= 0.07
    shown = np.stack([some, some & (rng.random(count) < 0.7)], axis=1)
    return first, second, person, np.stack([place, other_place], axis=1), shown


def _second(
    rng: np.random.Generator,
    sampler: BodySampler,
    cameras: Cameras,
    person: Person,
    place: Array,
    side: Array,
) -> tuple[Hands, Array]:
    """The other hand, usually of the same person, placed; and its place."""
    count = len(side)
    stranger = rng.random(count) < 0.15
    own_side = np.where(stranger, rng.choice([-1.0, 1.0], count), -side)
    hand = _draw_hands(rng, sampler, own_side)
    outwards = own_side[:, None] * person.right
    many = (count, TRIALS, 1)
    upper = _unit(
        person.face[:, None] * rng.uniform(0, 1.2, many)
        - person.up[:, None] * rng.uniform(-0.3, 1, many)
        + outwards[:, None] * rng.uniform(-0.4, 0.6, many)
        + 0.3 * rng.normal(size=(count, TRIALS, 3))
    )
    elbows = person.shoulder(own_side)[:, None] + ARM_MM * person.size[:, None] * upper
    turns = _rotations(rng, count, TRIALS)
    places = elbows - np.einsum("nkij,nj->nki", turns, hand.elbow)
    u, v = np.moveaxis(cameras.pixels(places), -1, 0)
    z = places[..., 2]
    seen = (u > 5) & (u < WIDTH - 5) & (v > 5) & (v < HEIGHT - 5) & (z > 220) & (z < 1700)
    ahead = ((places - elbows) * person.face[:, None]).sum(-1) > 0
    too_close = np.linalg.norm(places - place[:, None], axis=-1) < 70
    best = (3.0 * seen + rng.random(seen.shape) + 0.6 * ahead - 2.0 * too_close).argmax(1)
    rows = np.arange(count)
    near = place + _unit(rng.normal(size=(count, 3))) * rng.uniform(50, 200, (count, 1))
    anywhere = cameras.at(
        rng.uniform(5, WIDTH - 5, count),
        rng.uniform(5, HEIGHT - 5, count),
        place[:, 2] * np.exp(rng.uniform(-0.5, 0.5, count)),
    )
    close = rng.random(count) < 0.15
    chosen = np.select([close[:, None], stranger[:, None]], [near, anywhere], places[rows, best])
    return hand.placed(turns[rows, best], chosen), chosen


def _upright(rng: np.random.Generator, on_head: NDArray[np.bool_]) -> Array:
    """The direction upwards (N, 3) of cameras on a head, or elsewhere: held in any way."""
    count = len(on_head)
    # downwards
    pitch = np.deg2rad(np.where(on_head, rng.uniform(15, 85, count), rng.uniform(-25, 85, count)))
    any_roll = rng.random(count) < np.where(on_head, 0.1, 0.4)
    roll = np.deg2rad(
        np.where(any_roll, rng.uniform(-180, 180, count), 15 * rng.normal(size=count))
    )
    across = np.cos(pitch)
    return np.stack([across * np.sin(roll), across * np.cos(roll), -np.sin(pitch)], axis=1)


def _arm(
    rng: np.random.Generator, hand: Hands, person: Person, there: NDArray[np.bool_]
) -> Capsules:
    """Forearm, sleeve and upper arm (N, 3 capsules); some arms end early."""
    count = len(there)
    cut = np.where(rng.random(count) < 0.12, rng.uniform(0.1, 0.9, count), 1.0)[:, None]
    elbow = hand.wrist + cut * (hand.elbow - hand.wrist)
    sleeve = rng.uniform(0, 0.7, (count, 1))  # begins there
    thicker = np.where(rng.random(count) < 0.5, rng.uniform(2, 22, count), 0.0)
    radii = hand.arm_radii * rng.uniform(0.75, 1.45, (count, 1))
    shoulder = person.shoulder(hand.side)
    size = person.size[:, 0]
    upper = 48 * size * rng.uniform(0.8, 1.3, count) + thicker
    joined = (cut[:, 0] == 1) & (np.linalg.norm(hand.elbow - shoulder, axis=1) < 420 * size)
    begin = radii[:, 0] + sleeve[:, 0] * (radii[:, 1] - radii[:, 0]) + thicker
    end = radii[:, 1] + thicker
    a = np.stack([hand.wrist, hand.wrist + sleeve * (elbow - hand.wrist), elbow], axis=1)
    b = np.stack([elbow, elbow, np.where(joined[:, None], shoulder, elbow)], axis=1)
    ra = np.stack([radii[:, 0], begin, np.minimum(upper, end)], axis=1)
    rb = np.stack([radii[:, 1], end, np.where(joined, upper, np.minimum(upper, end))], axis=1)
    return _shown(Capsules(a, b, ra, rb), there[:, None])


def _body(rng: np.random.Generator, person: Person) -> Capsules:
    """Trunk, shoulders, neck, head, and the legs of some who sit."""
    count = len(person.size)
    axes = np.stack([person.right, person.up, person.face], axis=1)
    wide = rng.uniform(0.85, 1.35, (count, 1))
    points = np.array([ends[:2] for ends in BODY], dtype=np.float64)
    hip = np.array([(side * 95.0, -470.0, 20.0) for side in (-1, 1)])
    knee = np.stack(
        [
            hip[:, 0] + np.array([-1, 1]) * rng.uniform(-60, 120, (count, 1)),
            hip[:, 1] + rng.uniform(-120, 60, (count, 2)),
            np.full((count, 2), 440.0),
        ],
        axis=-1,
    )
    places = [np.broadcast_to(points[:, n], (count, len(BODY), 3)) for n in (0, 1)]
    a = np.concatenate([places[0], np.broadcast_to(hip, (count, 2, 3))], axis=1)
    b = np.concatenate([places[1], knee], axis=1)
    a, b = (person.middle[:, None] + person.size[:, None] * (part @ axes) for part in (a, b))
    ra = np.array([*(ra for _, _, ra, _ in BODY), 85, 85]) * person.size * wide
    rb = np.array([*(rb for _, _, _, rb in BODY), 62, 62]) * person.size * wide
    shown = np.ones((count, len(BODY) + 2), bool)
    shown[:, len(BODY) :] = rng.random((count, 1)) < 0.5
    return _shown(Capsules(a, b, ra, rb), shown)


# ------------------------------------------------------------------------------------- surroundings


def _table(rng: np.random.Generator, person: Person, near: Array) -> tuple[Solids, Array, Array]:
    """A board below ``near``, a point of its upper face, and its axes (N, 3, 3); the second
    is its normal.
    """
    count = len(near)
    below = np.where(
        rng.random(count) < 0.35, rng.uniform(12, 60, count), rng.uniform(60, 350, count)
    )[:, None]
    yaw = rng.uniform(0, 2 * np.pi, (count, 1))
    normal = _unit(person.up + 0.05 * rng.normal(size=(count, 3)))
    along = _unit(_across(person.right * np.cos(yaw) + person.face * np.sin(yaw), normal))
    axes = np.stack([along, normal, np.cross(along, normal)], axis=-1)
    top = near - normal * below
    center = (
        top
        - 15 * normal
        + person.face * rng.uniform(-150, 450, (count, 1))
        + person.right * rng.uniform(-400, 400, (count, 1))
    )
    half = np.stack(
        [rng.uniform(150, 900, count), np.full(count, 15.0), rng.uniform(150, 900, count)], axis=-1
    )
    board = Solids(
        np.full((count, 1), BOX),
        center[:, None],
        axes[:, None],
        half[:, None],
        np.ones((count, 1), bool),
    )
    return board, top, axes


def _things(
    rng: np.random.Generator, near: Array, top: Array, table: Array, with_table: NDArray[np.bool_]
) -> tuple[Solids, Capsules]:
    """Boxes, cylinders and ellipsoids, and sticks, cables, bundles like fingers: on the table
    or in the air.
    """
    count, solids, sticks = len(near), 20, 10
    kind = np.broadcast_to(np.repeat([BOX, CYLINDER, ELLIPSOID], (8, 8, 4)), (count, solids))
    half = np.exp(rng.uniform(np.log(12), np.log(160), (count, solids, 3)))
    radius = np.exp(rng.uniform(np.log(10), np.log(75), (count, solids)))
    half = np.where(
        (kind == CYLINDER)[..., None], np.stack([radius, half[..., 1], radius], axis=-1), half
    )
    half = np.where((kind == ELLIPSOID)[..., None], np.minimum(half, 120), half)
    center, on = _put(rng, near, top, table, with_table, half[..., 1])
    yaw = rng.uniform(0, 2 * np.pi, (count, solids, 1))
    along = np.cos(yaw) * table[:, None, :, 0] + np.sin(yaw) * table[:, None, :, 2]
    normal = np.broadcast_to(table[:, None, :, 1], along.shape)
    upright = np.stack([along, normal, np.cross(along, normal)], axis=-1)
    lying = (kind == CYLINDER) & (rng.random((count, solids)) < 0.25)
    upright = np.where(lying[..., None, None], upright[..., [1, 0, 2]], upright)
    center = center + (on & lying)[..., None] * normal * (radius - half[..., 1])[..., None]
    axes = np.where(on[..., None, None], upright, _rotations(rng, count, solids))
    shown = rng.random((count, solids)) < 0.45

    thick = np.exp(rng.uniform(np.log(3), np.log(24), (count, sticks)))
    a, _ = _put(rng, near, top, table, with_table, thick)
    bundle = (rng.random((count, 1)) < 0.35) & (np.arange(sticks) < 6)
    a = np.where(bundle[..., None], a[:, :1] + 25 * rng.normal(size=a.shape), a)
    common = 2 * _unit(rng.normal(size=(count, 1, 3))) * bundle[..., None]
    length = np.exp(rng.uniform(np.log(20), np.log(250), (count, sticks, 1)))
    b = a + _unit(rng.normal(size=a.shape) + common) * length
    capsules = Capsules(a, b, thick, thick * rng.uniform(0.6, 1.2, thick.shape))
    return (
        Solids(kind, center, axes, half, shown),
        _shown(capsules, bundle | (rng.random((count, sticks)) < 0.4)),
    )


def _put(
    rng: np.random.Generator,
    near: Array,
    top: Array,
    table: Array,
    with_table: NDArray[np.bool_],
    height: Array,
) -> tuple[Array, NDArray[np.bool_]]:
    """Middles (N, M, 3) of things whose half heights are (N, M), and which of them
    stand on the table.
    """
    shape = height.shape
    on = with_table[:, None] & (rng.random(shape) < 0.65)
    angle = rng.uniform(0, 2 * np.pi, (*shape, 1))
    flat = np.cos(angle) * table[:, None, :, 0] + np.sin(angle) * table[:, None, :, 2]
    standing = (
        top[:, None]
        + flat * rng.uniform(40, 450, (*shape, 1))
        + table[:, None, :, 1] * height[..., None]
    )
    free = near[:, None] + _unit(rng.normal(size=(*shape, 3))) * rng.uniform(90, 450, (*shape, 1))
    return np.where(on[..., None], standing, free), on


def _held(rng: np.random.Generator, hand: Hands, palm: Array, there: NDArray[np.bool_]) -> Solids:
    """What the hands hold, up to the palm and the tips of the fingers; and the wider top
    of some bottles.
    """
    count = len(palm)
    axis = _unit(hand.across + 0.15 * rng.normal(size=(count, 3)))
    away = rng.uniform(26, 85, count)
    center = palm + hand.distal * rng.uniform(0, 40, (count, 1)) + hand.palmar * away[:, None]
    tips = hand.tips - center[:, None]
    beside = np.linalg.norm(_across(tips, axis[:, None]), axis=-1).min(1) - 9
    radius = np.where(rng.random(count) < 0.65, np.minimum(away - 15, beside), away - 15)
    shown = there & (radius > 8) & (rng.random(count) < 0.4)
    radius = np.maximum(radius, 5)
    length = rng.uniform(15, 140, count)
    center = center + axis * (rng.uniform(-0.7, 0.7, count) * length)[:, None]
    front = _unit(_across(hand.palmar, axis))
    axes = np.stack([front, axis, np.cross(front, axis)], axis=-1)
    kind = rng.integers(3, size=count)
    deep = np.where(kind == CYLINDER, radius, radius * rng.uniform(0.4, 1.6, count))
    half = np.stack([radius, length, deep], axis=-1)
    wider = radius * rng.uniform(0.4, 2.0, count)
    top = np.stack([wider, rng.uniform(10, 60, count), wider], axis=-1)
    with_top = shown & (kind == CYLINDER) & (rng.random(count) < 0.5)
    return Solids(
        np.stack([kind, np.full(count, CYLINDER)], axis=1),
        np.stack([center, center + axis * length[:, None]], axis=1),
        np.stack([axes, axes], axis=1),
        np.stack([half, top], axis=1),
        np.stack([shown, with_top], axis=1),
    )


def _planes(
    rng: np.random.Generator, person: Person, near: Array, palm: Array, rays: tuple[Floats, Floats]
) -> Floats:
    """Depth of the floor, a wall behind, and one at the side."""
    count = len(near)
    floor = near - person.up * rng.uniform(450, 1300, (count, 1))
    behind = _unit(0.4 * rng.normal(size=(count, 3)) - (0, 0, 1))
    wall = np.zeros((count, 3))
    wall[:, 2] = palm[:, 2] + rng.uniform(60, 3000, count)
    beside = _unit(_across(rng.normal(size=(count, 3)), person.up))
    beside *= -np.sign(beside[:, 2:])
    corner = palm - beside * rng.uniform(150, 2000, (count, 1))
    depth = np.full((count, HEIGHT, WIDTH), np.inf, np.float32)
    for normal, point, share in (
        (person.up, floor, 0.6),
        (behind, wall, 0.6),
        (beside, corner, 0.35),
    ):
        plane = _plane_depth(normal, (normal * point).sum(1), rays)
        np.minimum(depth, _only(plane, rng.random(count) < share), out=depth)
    return depth


def _beyond(rng: np.random.Generator, near: Array) -> Solids:
    """Large round things behind the hands, of which a camera's range may leave a patch as
    large as a hand.
    """
    count, most = len(near), 5
    away = rng.uniform((-450, -350, 180), (450, 350, 900), (count, most, 3))
    half = np.exp(rng.uniform(np.log(50), np.log(300), (count, most, 3)))
    shown = (rng.random((count, most)) < 0.5) & (rng.random((count, 1)) < 0.4)
    kind = np.full((count, most), ELLIPSOID)
    return Solids(kind, near[:, None] + away, _rotations(rng, count, most), half, shown)


def _range(rng: np.random.Generator, palm: Array) -> Array:
    """The depth (N,) in mm from which nothing is read: some cameras end a little
    behind the hand.
    """
    behind = np.exp(rng.uniform(np.log(80), np.log(1200), len(palm)))
    return np.where(rng.random(len(palm)) < 0.35, palm[:, 2] + behind, np.inf)


# ---------------------------------------------------------------------------------- depth of shapes


def _render(capsules: Capsules, rays: tuple[Floats, Floats]) -> Floats:
    return render(in_front(capsules), *rays, np.full(len(capsules.a), np.inf))


def _plane_depth(normal: Array, offset: Array, rays: tuple[Floats, Floats]) -> Floats:
    """Depth (N, H, W) of the planes of points p with normal . p = offset; infinite
    where a ray misses.
    """
    x, y = rays
    n = normal.astype(np.float32)[:, :, None, None]
    slope = n[:, 0] * x[:, None, :] - n[:, 1] * y[:, :, None] + n[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = offset.astype(np.float32)[:, None, None] / slope
    return np.where(depth > NEAR_MM, depth, np.float32(np.inf))


def _solid_depth(solids: Solids, rays: tuple[Floats, Floats]) -> Floats:
    """Depth (N, H, W) of the nearest of the solids, infinite where there is none."""
    x, y = rays
    depth = np.full((len(x), y.shape[1], x.shape[1]), np.inf, np.float32)
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    for n, m in np.argwhere(solids.shown):
        axes, half, center = solids.axes[n, m], solids.half[n, m], solids.center[n, m]
        corners = center + (signs * half) @ axes.T
        if corners[:, 2].min() < NEAR_MM:
            continue
        slopes = corners[:, :2] / corners[:, 2:] * (1, -1)
        columns, rows = (
            slice(*np.searchsorted(line[n], (s.min(), s.max()))) for line, s in zip(rays, slopes.T)
        )
        part = depth[n, rows, columns]
        if part.size:
            entry = _entry(int(solids.kind[n, m]), center, axes, half, x[n, columns], y[n, rows])
            np.minimum(part, entry, out=part)
    return depth


def _entry(kind: int, center: Array, axes: Array, half: Array, x: Floats, y: Floats) -> Floats:
    """Depth (h, w) at which rays enter a solid, computed where it is a cube, cylinder or sphere of
    half length 1.
    """
    turned = (axes / half).T.astype(np.float32)
    o = -(turned @ center.astype(np.float32))
    d = [t[0] * x[None, :] - t[1] * y[:, None] + t[2] for t in turned]
    flat, round_ = {BOX: ([0, 1, 2], []), CYLINDER: ([1], [0, 2]), ELLIPSOID: ([], [0, 1, 2])}[kind]
    enter, leave = np.full(d[0].shape, -np.inf, np.float32), np.full(d[0].shape, np.inf, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in flat:
            one, two = (-1 - o[k]) / d[k], (1 - o[k]) / d[k]
            enter, leave = np.fmax(enter, np.fmin(one, two)), np.fmin(leave, np.fmax(one, two))
        if round_:
            dd, do = sum(d[k] * d[k] for k in round_), sum(d[k] * o[k] for k in round_)
            # NaN where the ray misses
            root = np.sqrt(do * do - dd * (sum(o[k] * o[k] for k in round_) - 1))
            enter, leave = (
                np.maximum(enter, (-do - root) / dd),
                np.minimum(leave, (-do + root) / dd),
            )
        return np.where(enter < leave, enter, np.float32(np.inf))


def _shown(capsules: Capsules, shown: NDArray[np.bool_]) -> Capsules:
    """Capsules of which those not shown (N, M) become invisible."""
    behind = np.array([0.0, 0.0, -1e4])  # in_front takes them away
    keep = shown[..., None]
    return capsules._replace(
        a=np.where(keep, capsules.a, behind), b=np.where(keep, capsules.b, behind)
    )


def _only(depth: Floats, there: NDArray[np.bool_]) -> Floats:
    """Depth (N, H, W) of the frames in which something is there (N,), else infinite."""
    return np.where(there[:, None, None], depth, np.float32(np.inf))


# ------------------------------------------------------------------------------- labels, directions


def _mostly_seen(whole: Floats, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether enough (N,) of hands with depths (N, H, W) is seen."""
    return seen.sum((1, 2)) > SEEN * np.maximum(np.isfinite(whole).sum((1, 2)), 1)


def _judged(scenes: Scenes) -> Scenes:
    """The scenes with those hands present that are read well enough too, and the
    others doubtful.
    """
    u, v = np.moveaxis(scenes.middle_px, -1, 0)
    z = scenes.middle[..., 2]
    inside = (u > 1) & (u < WIDTH - 2) & (v > 1) & (v < HEIGHT - 2)
    seen, read = (
        np.stack([(part == hand).sum((1, 2)) for hand in (1, 2)], axis=1)
        for part in (scenes.which, np.where(scenes.depth > 0, scenes.which, 0))
    )
    present = scenes.present & inside & (z < FARTHEST_MM) & (read > SEEN_PX) & (read > 0.35 * seen)
    return scenes._replace(present=present, doubtful=scenes.doubtful & ~present & (seen > 0))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def _across(v: Array, direction: Array) -> Array:
    """The part of vectors at a right angle to a direction of length 1."""
    return np.asarray(v - (v * direction).sum(-1, keepdims=True) * direction)


def _rotations(rng: np.random.Generator, *shape: int) -> Array:
    """Random rotation matrices (..., 3, 3), uniform."""
    w, x, y, z = np.moveaxis(_unit(rng.normal(size=(*shape, 4))), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
