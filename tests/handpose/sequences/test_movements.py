"""handpose/sequences/movements.py"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handpose.sequences.movements import OVERLAP, TOP_SPEED, Person, Turns, Values, eased, posed
from handpose.synthetic.pose_prior import BodySampler

SAMPLER = BodySampler()
PERSON = Person.draw(np.random.default_rng(3), SAMPLER)
HAND = SAMPLER.draw(np.random.default_rng(4), 2)
ARM = np.zeros(len(PERSON.surface.whole.initial) - len(SAMPLER.skeleton.initial))


def test_a_stroke() -> None:
    """A stroke begins and ends at rest, is half done at half time, and has a top speed of 1.875
    times the mean.
    """
    s = np.linspace(0, 1, 100001)
    e = eased(s)
    assert e[0] == 0
    assert e[-1] == 1
    assert e[50000] == pytest.approx(0.5)
    assert np.diff(e).max() * 100000 == pytest.approx(TOP_SPEED, abs=1e-6)
    assert_array_equal(eased(np.array([-1.0, 2.0])), [0, 1])


@given(
    st.lists(
        st.tuples(st.floats(0.1, 2), st.floats(-0.9, 1), st.floats(-3, 3)), min_size=1, max_size=6
    )
)
def test_values_stay_among_their_poses(strokes: list[tuple[float, float, float]]) -> None:
    """Values stay within their poses for any overlap of strokes, and end at the last pose."""
    values = Values(np.array([0.0]))
    for lasts, gap, to in strokes:
        before = values.lasts[-1] if values.lasts else 0.0
        values.move(values.end + gap * min(lasts, before), lasts, np.array([to]))
    keys = np.concatenate(values.keys)
    times = np.linspace(-1, values.end + 1, 60)
    found = np.array([values.at(t)[0] for t in times])
    assert (found >= keys.min() - 1e-9).all() and (found <= keys.max() + 1e-9).all()
    assert found[0] == 0 and found[-1] == pytest.approx(keys[-1])


def test_values_have_speed_and_acceleration_without_jumps() -> None:
    """Two overlapping strokes pass the middle pose without a stop, and are never faster
    than one stroke.
    """
    values = Values(np.array([0.0]))
    values.move(0.5, 1.0, np.array([1.0]))
    values.move(1.5 - OVERLAP, 1.0, np.array([2.0]))
    t = np.arange(0, 3, 1e-3)
    x = np.array([values.at(time)[0] for time in t])
    speed, acceleration = np.diff(x) / 1e-3, np.diff(x, 2) / 1e-6
    assert np.abs(np.diff(speed)).max() < 0.01
    assert np.abs(np.diff(acceleration)).max() < 0.1
    assert speed.max() == pytest.approx(TOP_SPEED, abs=1e-4)
    assert speed[(t[1:] > 0.7) & (t[1:] < 2.0)].min() > 0.4


def test_turns_take_the_shortest_way(rng: np.random.Generator) -> None:
    """A turn has a constant axis, is at most half a turn, and ends at its pose; overlapping
    ones do not jump.
    """
    keys = Rotation.random(4, rng)
    turns = Turns(keys[0])
    assert (turns.at(5.0) * keys[0].inv()).magnitude() < 1e-12
    for begin, key in ((1.0, 1), (3.0, 2), (3.7, 3)):
        turns.move(begin, 1.0, keys[key])
    for time, key in ((0.0, 0), (2.5, 1), (9.0, 3)):
        assert (turns.at(time) * keys[key].inv()).magnitude() < 1e-9
    whole = (keys[0].inv() * keys[1]).as_rotvec()
    for time in (1.2, 1.5, 1.9):
        part = (keys[0].inv() * turns.at(time)).as_rotvec()
        assert_allclose(part, whole * eased(np.array([time - 1.0])), atol=1e-9)
        assert np.linalg.norm(part) <= np.pi
    found = [turns.at(t) for t in np.arange(2.9, 5, 1e-3)]
    speed = np.array([(a.inv() * b).as_rotvec() for a, b in itertools.pairwise(found)]) / 1e-3
    assert np.abs(np.diff(speed, axis=0)).max() < 0.05


def test_posed_hands_have_their_middle_at_the_origin() -> None:
    """Posed hands have the requested rotation of the palm, for any person."""
    palm = Rotation.random(2, np.random.default_rng(2))
    fingers = HAND.inputs.copy()
    whole = posed(SAMPLER, PERSON, fingers, palm, np.stack([ARM, ARM]))
    kinematics = PERSON.surface.kinematics
    pose = kinematics.forward(whole, np.stack([PERSON.bones, PERSON.bones]))
    joint = SAMPLER.skeleton.joint_names.index("palm")
    assert_allclose(kinematics.rotation_of(pose, joint), palm.as_matrix(), atol=1e-9)
    assert_allclose(pose.joints[:, joint] + palm.apply(PERSON.center), 0, atol=1e-9)
    assert_array_equal(whole[:, SAMPLER.limbs], fingers[:, SAMPLER.limbs])


def test_a_sleeve_is_over_the_forearm(rng: np.random.Generator) -> None:
    """The sleeve covers the forearm from a given fraction to the elbow, and is thicker by
    a given length.
    """
    person = replace(Person.draw(rng, SAMPLER), sleeve=(0.25, 0.1))
    inputs = np.zeros(len(person.surface.whole.initial))
    capsules = person.capsules(inputs, np.array([0.0, 0, 600]), "right")
    worn = person.worn(capsules)
    arm = np.flatnonzero(person.surface.limbs)[0]
    assert_allclose(worn.b[0, 0], capsules.b[0, arm])
    assert_allclose(worn.a[0, 0], 0.75 * capsules.a[0, arm] + 0.25 * capsules.b[0, arm])
    assert np.isclose(worn.radius_b[0, 0] - capsules.radius_b[0, arm], 0.1 * person.unit_mm)
