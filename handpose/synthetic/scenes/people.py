"""People of whole scenes: from a hand to its arm, shoulders and head, and to the other hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH, Cameras
from handpose.synthetic.scenes.directions import across, dot, turned, unit
from handpose.synthetic.scenes.draws import Draw, Range
from handpose.synthetic.scenes.hands import Hands, draw_hands
from handpose.synthetic.scenes.prior import ArmParameter, BodyParameter, HandsParameter, ScenePrior
from handpose.synthetic.scenes.solids import shown
from netlib.blob import Array

LEFT, RIGHT = -1.0, 1.0  # sides
TRIALS = 16  # arrangements of an arm, of which the one with the highest score is taken
UPPER_ARM_MM = 290.0  # length, for a person of size 1
SHOULDER_MM = 170.0  # from the middle of the shoulders to one, for a person of size 1
MEAN_HAND_SCALE = 0.92  # scale of the hand of a person of size 1
MIN_SIZE, MAX_SIZE = 0.8, 1.2  # of people
OPTICAL_AXIS = np.array([0.0, 0.0, 1.0])
# Capsules of trunk, neck and head, and of the thighs from the hips on: start and end (right, up and
# forward of the middle of the shoulders), radius at the start and at the end, in mm.
BODY = np.array(
    [
        (-60, -60, 0, -60, -420, 10, 95, 110),
        (60, -60, 0, 60, -420, 10, 95, 110),
        (0, -120, 20, 0, -430, 30, 110, 125),
        (-140, -15, 0, 140, -15, 0, 65, 65),
        (0, 40, 15, 0, 150, 25, 58, 55),
        (0, 190, 30, 0, 255, 20, 85, 92),
        (-95, -470, 20, -95, -470, 20, 85, 62),
        (95, -470, 20, 95, -470, 20, 85, 62),
    ],
    np.float64,
)
LEGS = slice(-2, None)
KNEE_FORWARD_MM = 440.0  # of the middle of the shoulders
# relative to the hips
KNEE_OUTWARD_MM, KNEE_UP_MM = Range(-60.0, 120.0), Range(-120.0, 60.0)
MAX_UPPER_ARM_MM = 420.0  # a shoulder farther from the elbow belongs to another person

# A camera on a head: mean and standard deviation of the slope of its optical axis, ...
MEAN_SLOPE_DOWN, SLOPE_STD = 0.3, 0.25
# ... and ranges of the middle of the shoulders relative to it.
BELOW_MM, BEHIND_MM, ASIDE_MM = Range(60.0, 320.0), Range(-60.0, 150.0), Range(-100.0, 100.0)
FACE_STD = 0.6  # deviation of an owner's direction from that of the forearm
# Ranges of the direction of the first hand's upper arm, from the elbow to the shoulder, ...
ELBOW_BACK, ELBOW_UP, ELBOW_IN = Range(-0.2, 1.0), Range(-0.3, 1.1), Range(-0.3, 0.6)
# ... and of the other one's, from the shoulder to the elbow.
SHOULDER_FORWARD, SHOULDER_DOWN = Range(0.0, 1.2), Range(-0.3, 1.0)
SHOULDER_OUT = Range(-0.4, 0.6)
UPPER_ARM_STD = 0.3  # deviation of both directions

# An arrangement's score is a random number between 0 and 1, plus what follows.
# The first hand:
MIN_COSINE = -0.85  # of forearm and line of sight; below, the elbow is next to the camera
AT_CAMERA_PENALTY = 3.0
REACH_UNIT_MM = 120.0  # a penalty of 1 for each that the arm is too long or too short ...
MAX_REACH_PENALTY = 4.0  # ... up to this
HANGING_SCORE = 0.5  # an elbow below the hand, of people in front of the camera
RESTING_SCORE = 5.0  # a palm down, of hands on a table
ALONG_SCORE = 5.0  # a forearm along the line of sight, where that is required
# The other hand:
IN_SIGHT_SCORE = 3.0  # ``MARGIN_PX`` or more within the frame, at one of these depths:
MARGIN_PX, MIN_HAND_MM, MAX_HAND_MM = 5.0, 220.0, 1700.0
IN_FRONT_SCORE = 0.6  # in front of the body
TOO_CLOSE_MM, TOO_CLOSE_PENALTY = 70.0, 2.0  # to the first hand
LOG_DEPTH_RATIO = Range(-0.5, 0.5)  # of a stranger's hand and the first one


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
    draw: Draw,
    prior: ScenePrior,
    sampler: BodySampler,
    cameras: Cameras,
    sides: Sequence[float] = (LEFT, RIGHT),
) -> People:
    """A hand of one of the sides anywhere in each frame, its person, and the other hand."""
    hands = prior.hands
    place = cameras.anywhere(draw, hands.margin_px, draw(hands.distance))
    side = draw.rng.choice(sides, draw.count)
    first = draw_hands(draw, sampler, side)
    size = np.clip(first.bodies.scale / MEAN_HAND_SCALE, MIN_SIZE, MAX_SIZE)[:, None]
    wearer = _wearer(draw, cameras, size)
    rests = draw.chance(hands.rests)
    along = draw.chance(hands.along)
    rotation = _first_rotation(draw, cameras, wearer, first, place, rests, along)
    first = first.placed(rotation, place)
    person = _owner(draw, cameras, wearer, first)
    second, second_place = _second_hand(draw, hands, sampler, cameras, person, place, side)
    has_first = ~draw.chance(hands.none)
    has_second = has_first & draw.chance(hands.second)
    palms = np.stack([place, second_place], axis=1)
    there = np.stack([has_first, has_second], axis=1)
    return People((first, second), person, palms, there, rests)


def _wearer(draw: Draw, cameras: Cameras, size: Array) -> Torsos:
    """The people of these sizes (N, 1) on whose heads the cameras would be."""
    up = cameras.up
    ahead = OPTICAL_AXIS + SLOPE_STD * draw.normal(3)
    face = unit(across(ahead - MEAN_SLOPE_DOWN * up, up))
    right = np.cross(up, face)
    below = up * draw(BELOW_MM, 1)
    behind = face * draw(BEHIND_MM, 1)
    aside = right * draw(ASIDE_MM, 1)
    return Torsos(up, face, right, -below - behind + aside, size)


def _first_rotation(
    draw: Draw,
    cameras: Cameras,
    wearer: Torsos,
    hand: Hands,
    place: Array,
    rests: NDArray[np.bool_],
    along: NDArray[np.bool_],
) -> Array:
    """Rotations (N, 3, 3) of the first hands: the likeliest of some arrangements of their arms.

    place  (N, 3) mm, of the palms
    rests  (N,) whether the hand lies on a table
    along  (N,) whether the forearm is along the line of sight
    """
    up = cameras.up[:, None]
    rotations = draw.rotation(TRIALS)
    forearm = turned(rotations, unit(hand.elbow - hand.wrist))
    cosine = dot(forearm, unit(place)[:, None])  # negative: the elbow is nearer than the hand
    score = draw.between(0, 1, TRIALS) - AT_CAMERA_PENALTY * (cosine < MIN_COSINE)
    shoulder = wearer.shoulder(hand.side)[:, None]
    elbow = place[:, None] + turned(rotations, hand.elbow)
    upper_arm_mm = np.linalg.norm(elbow - shoulder, axis=-1)
    misfit = np.abs(upper_arm_mm - UPPER_ARM_MM * wearer.size) / REACH_UNIT_MM
    score -= cameras.on_head[:, None] * np.clip(misfit, 0, MAX_REACH_PENALTY)
    score += cameras.facing[:, None] * ((cosine > 0) - HANGING_SCORE * dot(forearm, up))
    score -= rests[:, None] * RESTING_SCORE * dot(turned(rotations, hand.palmar), up)
    score += along[:, None] * ALONG_SCORE * np.abs(cosine)
    return rotations[np.arange(draw.count), score.argmax(1)]


def _owner(draw: Draw, cameras: Cameras, wearer: Torsos, hand: Hands) -> Torsos:
    """The owners of the first hands: the cameras' wearers, or people placed at the arms."""
    up = cameras.up
    size = wearer.size
    forward = unit(hand.wrist - hand.elbow) + FACE_STD * draw.normal(3)
    on_head = cameras.on_head[:, None]
    face = np.where(on_head, wearer.face, unit(across(forward, up)))
    right = np.cross(up, face)
    outward = hand.side[:, None] * right
    backward = -face * draw(ELBOW_BACK, 1)
    upward = up * draw(ELBOW_UP, 1)
    inward = outward * draw(ELBOW_IN, 1)
    noise = UPPER_ARM_STD * draw.normal(3)
    direction = unit(backward + upward - inward + noise)
    placed = hand.elbow + UPPER_ARM_MM * size * direction
    shoulder = np.where(on_head, wearer.shoulder(hand.side), placed)
    return Torsos(up, face, right, shoulder - outward * SHOULDER_MM * size, size)


def _second_hand(
    draw: Draw,
    prior: HandsParameter,
    sampler: BodySampler,
    cameras: Cameras,
    person: Torsos,
    place: Array,
    side: Array,
) -> tuple[Hands, Array]:
    """The other hand, usually of the same person, placed; and its place (N, 3).

    place  (N, 3) mm, of the first hands
    side   (N,) of the first hands
    """
    of_stranger = draw.chance(prior.stranger)
    own_side = np.where(of_stranger, draw.rng.choice((LEFT, RIGHT), draw.count), -side)
    hand = draw_hands(draw, sampler, own_side)
    elbows = _second_elbows(draw, person, own_side)
    rotations = draw.rotation(TRIALS)
    places = elbows - turned(rotations, hand.elbow)
    in_sight = _in_sight(cameras, places)
    in_front = dot(places - elbows, person.face[:, None]) > 0
    too_close = np.linalg.norm(places - place[:, None], axis=-1) < TOO_CLOSE_MM
    score = IN_SIGHT_SCORE * in_sight + draw.between(0, 1, TRIALS)
    score += IN_FRONT_SCORE * in_front
    score -= TOO_CLOSE_PENALTY * too_close
    best = np.arange(draw.count), score.argmax(1)
    nearby = place + draw.direction() * draw(prior.close_mm, 1)
    depth = place[:, 2] * np.exp(draw(LOG_DEPTH_RATIO))
    anywhere = cameras.anywhere(draw, MARGIN_PX, depth)
    is_nearby = draw.chance(prior.close)
    kinds = [is_nearby[:, None], of_stranger[:, None]]
    own_place = np.select(kinds, [nearby, anywhere], places[best])
    return hand.placed(rotations[best], own_place), own_place


def _in_sight(cameras: Cameras, places: Array) -> NDArray[np.bool_]:
    """Whether hands at places (N, ..., 3) are in the frame, and at depths of hands."""
    u, v = np.moveaxis(cameras.pixels(places), -1, 0)
    z = places[..., 2]
    in_width = (u > MARGIN_PX) & (u < WIDTH - MARGIN_PX)
    in_height = (v > MARGIN_PX) & (v < HEIGHT - MARGIN_PX)
    return in_width & in_height & (z > MIN_HAND_MM) & (z < MAX_HAND_MM)


def _second_elbows(draw: Draw, person: Torsos, side: Array) -> Array:
    """Places (N, TRIALS, 3) of the elbows of the other arms."""
    sideways = side[:, None] * person.right
    forward = person.face[:, None] * draw(SHOULDER_FORWARD, TRIALS, 1)
    downward = person.up[:, None] * draw(SHOULDER_DOWN, TRIALS, 1)
    outward = sideways[:, None] * draw(SHOULDER_OUT, TRIALS, 1)
    noise = UPPER_ARM_STD * draw.normal(TRIALS, 3)
    direction = unit(forward - downward + outward + noise)
    upper_arm = UPPER_ARM_MM * person.size[:, None] * direction
    return person.shoulder(side)[:, None] + upper_arm


def draw_arm(
    draw: Draw, prior: ArmParameter, hand: Hands, person: Torsos, there: NDArray[np.bool_]
) -> Capsules:
    """Forearm, sleeve and upper arm (N, 3 capsules); some arms end early.

    there  (N,) whether there is an arm
    """
    is_cut = draw.chance(prior.cut)
    length = np.where(is_cut, draw(prior.cut_at), 1.0)  # relative to the forearm's
    wrist = hand.wrist
    elbow = wrist + length[:, None] * (hand.elbow - wrist)
    sleeve_from = draw(prior.sleeve_from)
    has_sleeve = draw.chance(prior.sleeve)
    sleeve_mm = np.where(has_sleeve, draw(prior.sleeve_mm), 0.0)
    cuff = wrist + sleeve_from[:, None] * (elbow - wrist)
    at_wrist, at_elbow = (hand.arm_radii * draw(prior.thickness, 1)).T
    at_cuff = at_wrist + sleeve_from * (at_elbow - at_wrist) + sleeve_mm
    size = person.size[:, 0]
    at_shoulder = draw(prior.upper) * size + sleeve_mm
    sleeve_end = at_elbow + sleeve_mm
    upper_start = np.minimum(at_shoulder, sleeve_end)
    shoulder = person.shoulder(hand.side)
    is_own = np.linalg.norm(hand.elbow - shoulder, axis=1) < MAX_UPPER_ARM_MM * size
    has_upper = (length == 1) & is_own
    a = np.stack([wrist, cuff, elbow], axis=1)
    b = np.stack([elbow, elbow, np.where(has_upper[:, None], shoulder, elbow)], axis=1)
    radius_a = np.stack([at_wrist, at_cuff, upper_start], axis=1)
    upper_end = np.where(has_upper, at_shoulder, upper_start)
    radius_b = np.stack([at_elbow, sleeve_end, upper_end], axis=1)
    return shown(Capsules(a, b, radius_a, radius_b), there[:, None])


def draw_body(draw: Draw, prior: BodyParameter, person: Torsos) -> Capsules:
    """Trunk, shoulders, neck, head, and the legs of some who sit."""
    axes = np.stack([person.right, person.up, person.face], axis=1)
    begin = BODY[:, :3]
    end = np.tile(BODY[:, 3:6], (draw.count, 1, 1))
    end[:, LEGS, 0] += np.array([-1, 1]) * draw(KNEE_OUTWARD_MM, 1)
    end[:, LEGS, 1] += draw(KNEE_UP_MM, 2)
    end[:, LEGS, 2] = KNEE_FORWARD_MM
    middle, size = person.middle[:, None], person.size[:, None]
    a, b = (middle + size * (points @ axes) for points in (begin, end))
    width = person.size * draw(prior.width, 1)
    there = np.ones(a.shape[:2], bool)
    there[:, LEGS] = draw.chance(prior.legs)[:, None]
    return shown(Capsules(a, b, BODY[:, 6] * width, BODY[:, 7] * width), there)
