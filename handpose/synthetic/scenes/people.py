"""People of whole scenes: from a hand to its arm, shoulders and head, and to the other hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH, Cameras
from handpose.synthetic.scenes.directions import (
    across,
    any_direction,
    any_rotation,
    dot,
    turned,
    unit,
)
from handpose.synthetic.scenes.hands import Hands, draw_hands
from handpose.synthetic.scenes.prior import ArmParameter, BodyParameter, HandsParameter, ScenePrior
from handpose.synthetic.scenes.solids import shown
from netlib.blob import Array

TRIALS = 16  # arrangements of an arm, of which the best is taken
ARM_MM, SHOULDER_MM = 290.0, 170.0  # upper arm; from the middle of the shoulders to one
USUAL = 0.92  # size of the mean hand, for which these lengths are
SMALLEST, LARGEST = 0.8, 1.2  # people
AHEAD = np.array([0.0, 0.0, 1.0])  # where the camera looks
BODY = (  # right, up and forward of the middle of the shoulders: from, to; both radii
    ((-60, -60, 0), (-60, -420, 10), 95, 110),
    ((60, -60, 0), (60, -420, 10), 95, 110),
    ((0, -120, 20), (0, -430, 30), 110, 125),
    ((-140, -15, 0), (140, -15, 0), 65, 65),
    ((0, 40, 15), (0, 150, 25), 58, 55),
    ((0, 190, 30), (0, 255, 20), 85, 92),
)
THIGH = (85.0, 62.0)  # radii at hip and knee
HIP = ((-95.0, -470.0, 20.0), (95.0, -470.0, 20.0))
KNEE_MM = 440.0  # forward of the middle of the shoulders
KNEES_APART_MM, KNEES_LOWER_MM = (-60.0, 120.0), (-120.0, 60.0)  # than the hips
LONGEST_MM = 420.0  # of upper arms; a shoulder farther away belongs to another person

# Ranges of directions and distances, relative to each other or in mm.
LOOKS_DOWN, LOOKS_ASIDE = 0.3, 0.25  # a camera on a head: mean, and deviation
# from such a camera to the middle of the shoulders
BELOW_MM, BEHIND_MM, ASIDE_MM = (60.0, 320.0), (-60.0, 150.0), (-100.0, 100.0)
FACES_ASIDE = 0.6  # deviation of an owner's direction from that of the forearm
# the first upper arm, from the elbow on
BACKWARDS, UPWARDS, INWARDS = (-0.2, 1.0), (-0.3, 1.1), (-0.3, 0.6)
# the other one, from the shoulder on
FORWARDS, DOWNWARDS, OUTWARDS = (0.0, 1.2), (-0.3, 1.0), (-0.4, 0.6)
ANYHOW = 0.3  # deviation of both

# Scores of arrangements, of which each also gets a random number between 0 and 1.
AT_CAMERA, PENALTY_AT_CAMERA = -0.85, 3.0  # an elbow nearer to the camera than the hand
TOO_FAR_MM, MAX_TOO_FAR = 120.0, 4.0  # a penalty of 1 for each, up to a maximum
HANGS = 0.5  # an elbow below the hand, of people in front of the camera, ...
RESTS, ALONG = 5.0, 5.0  # ... a palm down, an arm along the line of sight
IN_SIGHT, IN_FRONT, TOO_CLOSE = 3.0, 0.6, 2.0  # of the other hand
MARGIN_PX, SIGHT_MM, CLOSE_MM = 5.0, (220.0, 1700.0), 70.0  # what these mean
DEPTH_RATIO = (-0.5, 0.5)  # logarithm, of strangers' hands


class Torsos(NamedTuple):
    """Directions and places of the torsos of N people: (N, 3) each, and the size (N, 1)."""

    up: Array
    face: Array
    right: Array
    middle: Array  # between the shoulders
    size: Array

    def shoulder(self, side: Array) -> Array:
        """The shoulders of the given sides (N,)."""
        return self.middle + side[:, None] * self.right * SHOULDER_MM * self.size


class People(NamedTuple):
    """Two placed hands in each frame, and whose they are."""

    hands: tuple[Hands, Hands]
    person: Torsos
    palms: Array  # (N, 2, 3)
    there: NDArray[np.bool_]  # (N, 2)
    rests: NDArray[np.bool_]  # (N,) the first one, on a table


def draw_people(
    rng: np.random.Generator, prior: ScenePrior, sampler: BodySampler, cameras: Cameras
) -> People:
    """A hand anywhere in each frame, its person, and the other hand."""
    count = len(cameras.focal)
    hands = prior.hands
    place = cameras.anywhere(rng, hands.margin_px, hands.distance.draw(rng, count))
    side = rng.choice([-1.0, 1.0], count)
    first = draw_hands(rng, sampler, side)
    size = np.clip(first.scale / USUAL, SMALLEST, LARGEST)[:, None]
    wearer = _wearer(rng, cameras, size)
    rests = rng.random(count) < hands.rests
    along = rng.random(count) < hands.along
    turn = _turn_of_first(rng, cameras, wearer, first, place, rests, along)
    first = first.placed(turn, place)
    person = _owner(rng, cameras, wearer, first)
    second, other_place = _second(rng, hands, sampler, cameras, person, place, side)
    some = rng.random(count) >= hands.none
    there = np.stack([some, some & (rng.random(count) < hands.second)], axis=1)
    palms = np.stack([place, other_place], axis=1)
    return People((first, second), person, palms, there, rests)


def _wearer(rng: np.random.Generator, cameras: Cameras, size: Array) -> Torsos:
    """The people on whose heads the cameras would be."""
    count = len(size)
    up = cameras.up
    ahead = AHEAD + LOOKS_ASIDE * rng.normal(size=(count, 3))
    face = unit(across(ahead - LOOKS_DOWN * up, up))
    right = np.cross(up, face)
    below = up * rng.uniform(*BELOW_MM, (count, 1))
    behind = face * rng.uniform(*BEHIND_MM, (count, 1))
    aside = right * rng.uniform(*ASIDE_MM, (count, 1))
    return Torsos(up, face, right, -below - behind + aside, size)


def _turn_of_first(
    rng: np.random.Generator,
    cameras: Cameras,
    wearer: Torsos,
    hand: Hands,
    place: Array,
    rests: NDArray[np.bool_],
    along: NDArray[np.bool_],
) -> Array:
    """Rotations (N, 3, 3) of the first hands: the likeliest of some arrangements of their arms."""
    count = len(place)
    up = cameras.up[:, None]
    turns = any_rotation(rng, count, TRIALS)
    forearm = turned(turns, unit(hand.elbow - hand.wrist))
    away = dot(forearm, unit(place)[:, None])  # negative: the elbow is nearer than the hand
    score = rng.random((count, TRIALS)) - PENALTY_AT_CAMERA * (away < AT_CAMERA)
    shoulder = wearer.shoulder(hand.side)[:, None]
    reach = np.linalg.norm(place[:, None] + turned(turns, hand.elbow) - shoulder, axis=-1)
    too_far = np.abs(reach - ARM_MM * wearer.size) / TOO_FAR_MM
    score -= cameras.on_head[:, None] * np.clip(too_far, 0, MAX_TOO_FAR)
    score += cameras.facing[:, None] * ((away > 0) - HANGS * dot(forearm, up))
    score -= rests[:, None] * RESTS * dot(turned(turns, hand.palmar), up)
    score += along[:, None] * ALONG * np.abs(away)
    return turns[np.arange(count), score.argmax(1)]


def _owner(rng: np.random.Generator, cameras: Cameras, wearer: Torsos, hand: Hands) -> Torsos:
    """The owners of the first hands: the cameras' wearers, or people placed at the arms."""
    count = len(hand.side)
    up = cameras.up
    outwards = hand.side[:, None]
    forward = unit(hand.wrist - hand.elbow) + FACES_ASIDE * rng.normal(size=(count, 3))
    on_head = cameras.on_head[:, None]
    face = np.where(on_head, wearer.face, unit(across(forward, up)))
    right = np.cross(up, face)
    backwards = -face * rng.uniform(*BACKWARDS, (count, 1))
    upwards = up * rng.uniform(*UPWARDS, (count, 1))
    aside = outwards * right * rng.uniform(*INWARDS, (count, 1))
    anyhow = ANYHOW * rng.normal(size=(count, 3))
    upper = unit(backwards + upwards - aside + anyhow)
    size = wearer.size
    shoulder = np.where(on_head, wearer.shoulder(hand.side), hand.elbow + ARM_MM * size * upper)
    return Torsos(up, face, right, shoulder - outwards * right * SHOULDER_MM * size, size)


def _second(
    rng: np.random.Generator,
    prior: HandsParameter,
    sampler: BodySampler,
    cameras: Cameras,
    person: Torsos,
    place: Array,
    side: Array,
) -> tuple[Hands, Array]:
    """The other hand, usually of the same person, placed; and its place."""
    count = len(side)
    stranger = rng.random(count) < prior.stranger
    own_side = np.where(stranger, rng.choice([-1.0, 1.0], count), -side)
    hand = draw_hands(rng, sampler, own_side)
    elbows = _other_elbows(rng, person, own_side)
    turns = any_rotation(rng, count, TRIALS)
    places = elbows - turned(turns, hand.elbow)
    seen = _in_sight(cameras, places)
    ahead = dot(places - elbows, person.face[:, None]) > 0
    too_close = np.linalg.norm(places - place[:, None], axis=-1) < CLOSE_MM
    score = IN_SIGHT * seen + rng.random(seen.shape) + IN_FRONT * ahead - TOO_CLOSE * too_close
    best = score.argmax(1)
    rows = np.arange(count)
    near = place + any_direction(rng, count) * prior.close_mm.draw(rng, count, 1)
    depth = place[:, 2] * np.exp(rng.uniform(*DEPTH_RATIO, count))
    anywhere = cameras.anywhere(rng, MARGIN_PX, depth)
    close = rng.random(count) < prior.close
    where = np.select([close[:, None], stranger[:, None]], [near, anywhere], places[rows, best])
    return hand.placed(turns[rows, best], where), where


def _in_sight(cameras: Cameras, places: Array) -> NDArray[np.bool_]:
    """Whether hands at places (N, ..., 3) are in the frame, and at depths of hands."""
    u, v = np.moveaxis(cameras.pixels(places), -1, 0)
    z = places[..., 2]
    nearest, farthest = SIGHT_MM
    in_width = (u > MARGIN_PX) & (u < WIDTH - MARGIN_PX)
    in_height = (v > MARGIN_PX) & (v < HEIGHT - MARGIN_PX)
    return in_width & in_height & (z > nearest) & (z < farthest)


def _other_elbows(rng: np.random.Generator, person: Torsos, side: Array) -> Array:
    """Places (N, TRIALS, 3) of the elbows of the other arms."""
    count = len(side)
    many = (count, TRIALS, 1)
    outwards = side[:, None] * person.right
    ahead = person.face[:, None] * rng.uniform(*FORWARDS, many)
    downwards = person.up[:, None] * rng.uniform(*DOWNWARDS, many)
    aside = outwards[:, None] * rng.uniform(*OUTWARDS, many)
    anyhow = ANYHOW * rng.normal(size=(count, TRIALS, 3))
    upper = unit(ahead - downwards + aside + anyhow)
    arm = ARM_MM * person.size[:, None] * upper
    return person.shoulder(side)[:, None] + arm


def draw_arm(
    rng: np.random.Generator,
    prior: ArmParameter,
    hand: Hands,
    person: Torsos,
    there: NDArray[np.bool_],
) -> Capsules:
    """Forearm, sleeve and upper arm (N, 3 capsules); some arms end early."""
    count = len(there)
    ends = np.where(rng.random(count) < prior.cut, prior.cut_at.draw(rng, count), 1.0)[:, None]
    elbow = hand.wrist + ends * (hand.elbow - hand.wrist)
    sleeve = prior.sleeve_from.draw(rng, count)
    worn = rng.random(count) < prior.sleeve
    thicker = np.where(worn, prior.sleeve_mm.draw(rng, count), 0.0)
    radii = hand.arm_radii * prior.thickness.draw(rng, count, 1)
    shoulder = person.shoulder(hand.side)
    size = person.size[:, 0]
    upper = prior.upper.draw(rng, count) * size + thicker
    is_own = np.linalg.norm(hand.elbow - shoulder, axis=1) < LONGEST_MM * size
    joined = (ends[:, 0] == 1) & is_own
    wider = radii[:, 1] - radii[:, 0]
    begin = radii[:, 0] + sleeve * wider + thicker
    end = radii[:, 1] + thicker
    at_elbow = np.minimum(upper, end)
    middle = hand.wrist + sleeve[:, None] * (elbow - hand.wrist)
    a = np.stack([hand.wrist, middle, elbow], axis=1)
    b = np.stack([elbow, elbow, np.where(joined[:, None], shoulder, elbow)], axis=1)
    ra = np.stack([radii[:, 0], begin, at_elbow], axis=1)
    rb = np.stack([radii[:, 1], end, np.where(joined, upper, at_elbow)], axis=1)
    return shown(Capsules(a, b, ra, rb), there[:, None])


def draw_body(rng: np.random.Generator, prior: BodyParameter, person: Torsos) -> Capsules:
    """Trunk, shoulders, neck, head, and the legs of some who sit."""
    count = len(person.size)
    axes = np.stack([person.right, person.up, person.face], axis=1)
    hip = np.array(HIP)
    aside = hip[:, 0] + np.array([-1, 1]) * rng.uniform(*KNEES_APART_MM, (count, 1))
    down = hip[:, 1] + rng.uniform(*KNEES_LOWER_MM, (count, 2))
    knee = np.stack([aside, down, np.full((count, 2), KNEE_MM)], axis=-1)
    points = np.array([ends[:2] for ends in BODY], dtype=np.float64)
    begin, end = (np.broadcast_to(points[:, n], (count, len(BODY), 3)) for n in (0, 1))
    a = np.concatenate([begin, np.broadcast_to(hip, (count, 2, 3))], axis=1)
    b = np.concatenate([end, knee], axis=1)
    middle, size = person.middle[:, None], person.size[:, None]
    a, b = (middle + size * (part @ axes) for part in (a, b))
    wide = person.size * prior.width.draw(rng, count, 1)
    ra = np.array([*(ra for _, _, ra, _ in BODY), THIGH[0], THIGH[0]]) * wide
    rb = np.array([*(rb for _, _, _, rb in BODY), THIGH[1], THIGH[1]]) * wide
    there = np.ones((count, len(BODY) + 2), bool)
    there[:, len(BODY) :] = rng.random((count, 1)) < prior.legs
    return shown(Capsules(a, b, ra, rb), there)
