"""handpose/sequences/person.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handpose.sequences.person import Person
from handpose.synthetic.pose_prior import BodySampler

SAMPLER = BodySampler()


def test_people_differ_and_stay_themselves() -> None:
    """People differ in bones, size and surface; the same seed gives the same person."""
    one, again, other = (Person.draw(np.random.default_rng(seed), SAMPLER) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.bones, again.bones)
    np.testing.assert_array_equal(one.radii, again.radii)
    assert one.size != other.size and not np.allclose(one.radii / one.size, other.radii / other.size)
    assert one.radii.shape == SAMPLER.surface.radii.shape and (one.radii > 0).all()


def test_a_sleeve_is_over_the_forearm() -> None:
    """The sleeve covers the forearm from a given fraction to the elbow, and is thicker by a given length."""
    person = replace(Person.draw(np.random.default_rng(0), SAMPLER), sleeve=(0.25, 0.1))
    inputs = np.zeros(len(person.surface.whole.initial))
    capsules = person.capsules(inputs, np.array([0.0, 0, 600]), "right")
    worn = person.worn(capsules)
    arm = np.flatnonzero(person.surface.limbs)[0]
    np.testing.assert_allclose(worn.b[0, 0], capsules.b[0, arm])
    np.testing.assert_allclose(worn.a[0, 0], 0.75 * capsules.a[0, arm] + 0.25 * capsules.b[0, arm])
    assert np.isclose(worn.radius_b[0, 0] - capsules.radius_b[0, arm], 0.1 * person.unit_mm)


def test_penetration() -> None:
    """Straight fingers hardly penetrate each other; the depth is in mm and grows with the radii."""
    person = Person.draw(np.random.default_rng(0), SAMPLER)
    inputs = np.zeros((1, len(person.surface.whole.initial)))
    thin, thick = person.penetration_mm(inputs)[0], replace(person, radii=person.radii + 0.1).penetration_mm(inputs)[0]
    assert thin < 5 and np.isclose(thick - thin, 2 * 0.1 * person.unit_mm, atol=8)
