"""handpose/sequences/acts.py, and the named poses"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.frames.cameras import ICVL, NYU, Camera
from handpose.sequences.acts import MARGIN_MM, MAX_FINGER_RAD_S, MAX_HAND_MM_S, Act, Actor, Volume
from handpose.sequences.movements import Movement, Person, fingers_of, poses
from handpose.synthetic.pose_prior import BodySampler

SAMPLER = BodySampler()
FINGERS = ("little", "ring", "middle", "index")
STEP = 1 / 60


def played(
    *acts: Act, seconds: float, seed: int = 1, side: str = "right", outward: float = 0.0
) -> Movement:
    """The movement of one person's hand."""
    rng = np.random.default_rng(seed)
    person = Person.draw(rng, SAMPLER)
    return Actor(rng, SAMPLER, person, side, Volume(NYU).roomy(), outward).act(acts, seconds)


def test_a_moving_hand_is_a_hand_that_moves() -> None:
    """Limits, speeds and penetration stay within their bounds, and the hand rests at times."""
    movement = played(Act("moving", 12), seconds=12)
    times = np.arange(0, 12, STEP)
    whole = np.stack([movement.inputs_at(t) for t in times])
    fingers = np.stack([movement.fingers.at(t) for t in times])
    place = np.stack([movement.place.at(t) for t in times])
    skeleton = SAMPLER.skeleton
    bounded = SAMPLER.limbs
    assert (fingers[:, bounded] <= skeleton.upper[bounded] + 1e-9).all()
    assert (fingers[:, bounded] >= skeleton.lower[bounded] - 1e-9).all()
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / STEP
    assert 300 < speed.max() <= MAX_HAND_MM_S * 1.001
    assert 1 < np.abs(np.diff(fingers, axis=0)).max() / STEP <= MAX_FINGER_RAD_S * 1.001
    depth = movement.person.penetration_mm(whole)
    assert np.percentile(depth, 95) <= SAMPLER.prior.penetration
    assert depth.max() < 2 * SAMPLER.prior.penetration
    still = (np.abs(np.diff(whole, axis=0)).max(axis=1) < 1e-9) & (speed < 1e-6)
    assert still.sum() * STEP > 1.5 and (~still).sum() * STEP > 6


def test_a_hand_returns_however_long_the_movement_is_to_be() -> None:
    """The way back is the same if the movement ends before the hand has returned."""
    acts = (Act("moving", 3), Act("away", 6))
    short, long = played(*acts, seconds=8.9), played(*acts, seconds=20)
    assert_allclose(short.place.at(8.8), long.place.at(8.8), atol=1e-6)
    assert 0 < NYU.project(short.place.at(8.8))[0] < NYU.width


@pytest.mark.parametrize("first", [True, False])
def test_away(first: bool) -> None:
    """A hand leaves the image and returns to its place; as the first act it starts outside; it can
    stay away long.
    """
    acts = (Act("away", 4),) if first else (Act("rest", 1), Act("away", 4))
    movement = played(*acts, Act("rest", 2), Act("away", 9), seconds=10 - first)
    times = np.arange(0, 10 - first, 0.5)
    u = [float(NYU.project(movement.place.at(t))[0]) for t in times]
    gone = [not 0 < column < NYU.width for column in u]
    assert gone[0] is first and gone[-1] and any(not now for now in gone)
    back = 4.5 if first else 5.5
    inside = movement.place.at(back)
    assert 0 < NYU.project(inside)[0] < NYU.width
    if not first:
        assert_allclose(inside, movement.place.at(0.0))


def test_a_wave_turns_the_palm_to_and_fro() -> None:
    movement = played(Act("wave", 4), seconds=4)
    start = movement.palm.at(0.0)
    turned = [
        float((movement.palm.at(t) * start.inv()).as_rotvec()[2]) for t in np.arange(0, 4, 0.05)
    ]
    assert max(turned) > 0.38 and min(turned) < -0.38


def test_elbows_stay_on_their_side() -> None:
    for side, outward in (("right", -1.0), ("left", 1.0)):
        movement = played(Act("moving", 6), seconds=6, side=side, outward=outward)
        for time in np.arange(0, 6, 0.5):
            pose = movement.pose_at(time)
            limb = (pose.capsules.b - pose.capsules.a)[0, SAMPLER.surface.limbs][0]
            limb /= np.linalg.norm(limb)
            assert limb[0] * outward > -0.75
            assert limb[1] < 0.6
            assert limb[2] > -0.6


def test_gestures_as_poses_by_name() -> None:
    """The poses have every DoF of fingers and thumb and no other, rounded and within the limits."""
    sampler = BodySampler()
    skeleton = sampler.skeleton
    found = poses(BodySampler())
    assert list(found) == list(sampler.poses) and found == poses(sampler)
    for inputs in found.values():
        assert len(inputs) == 20 and not any(name.startswith("palm") for name in inputs)
        for name, value in inputs.items():
            d = skeleton.dof_names.index(name)
            assert skeleton.lower[d] - 1e-4 <= value <= skeleton.upper[d] + 1e-4
            assert value == round(value, 4)
    for finger in FINGERS:
        assert found["fist"][f"{finger}_base_rot_x"] < found["open"][f"{finger}_base_rot_x"] - 0.5


def test_gestures_of_a_person() -> None:
    """Fingers do not penetrate each other, and gestures differ."""
    person = Person.draw(np.random.default_rng(5), SAMPLER)
    fingers = np.stack([fingers_of(name, person, SAMPLER) for name in SAMPLER.poses])
    whole = np.zeros((len(fingers), len(person.surface.whole.initial)))
    whole[:, : fingers.shape[1]] = fingers
    assert (person.penetration_mm(whole) <= SAMPLER.prior.penetration).all()
    assert len(np.unique(fingers, axis=0)) >= len(fingers) - 1  # point equals one


@pytest.mark.parametrize("camera", [NYU, ICVL])
def test_places_are_in_the_image(camera: Camera) -> None:
    """Places are within the given part of the image, for any field of view; outside places are
    outside the image.
    """
    rng = np.random.default_rng(7)
    volume = Volume(camera, left=0.5).roomy()
    for _ in range(50):
        place = volume.place(rng)
        u, v, d = camera.project(place)
        across = MARGIN_MM * camera.fx / d - 1e-6
        down = MARGIN_MM * camera.fy / d - 1e-6
        assert 0.5 * camera.width + across < u < camera.width - across
        assert down < v < camera.height - down
        assert volume.near <= d <= volume.far
        assert_allclose(volume.clipped(place), place)
        assert not 0 < camera.project(volume.outside(place))[0] < camera.width
    u, v, d = camera.project(volume.clipped(np.array([9e3, -9e3, 100.0])))
    assert u < camera.width and v < camera.height and d == pytest.approx(volume.near)
