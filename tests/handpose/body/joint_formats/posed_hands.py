"""Hands for the tests of formats and angles."""

from __future__ import annotations

import numpy as np

from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import NYU_HAND, load
from netlib.blob import Array

PEOPLE = load(NYU_HAND.with_name("people.prototxt"))
MIRROR = np.array([-1.0, 1.0, 1.0])


def any_pose(rng: np.random.Generator) -> Array:
    """Inputs (D,) within the limits, with the palm at any place and orientation."""
    inputs = rng.uniform(np.maximum(PEOPLE.lower, -np.pi), np.minimum(PEOPLE.upper, np.pi))
    inputs[:3] = rng.normal(size=3)
    inputs[3:6] = rng.uniform(-np.pi, np.pi, 3)
    return np.asarray(inputs)


def right_hand(inputs: Array, unit_mm: float = 130.0) -> Array:
    """Joints (K, 3) in mm of a right hand, half a metre in front of the camera."""
    return np.asarray(Kinematics(PEOPLE).joints(inputs[None])[0] * unit_mm + [0, 0, 500])
