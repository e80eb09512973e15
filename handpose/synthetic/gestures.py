"""Gestures with a name, as far as the skeleton's limits let fingers go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.synthetic.person import Person
from handpose.synthetic.pose_prior import HandSampler
from netlib.blob import Array


class Gesture(NamedTuple):
    """How fingers are held, as parts of the range between the skeleton's limits.

    bent    little, ring, middle, index finger: 0 straight, 1 bent
    thumb   pip_rot_y, pip_rot_z, dip_rot_z, tip_rot_z: 0 the lower limit, 1 the upper
    """

    bent: tuple[float, float, float, float]
    thumb: tuple[float, float, float, float]


OUT, BESIDE, ACROSS = (0.5, 0.1, 0.7, 0.4), (0.3, 0.75, 0.8, 0.3), (0.9, 0.65, 0.6, 0.7)
GESTURES = {
    "open": Gesture((0.15, 0.15, 0.15, 0.15), OUT),
    "relaxed": Gesture((0.35, 0.35, 0.3, 0.25), (0.5, 0.4, 0.6, 0.4)),
    "fist": Gesture((0.8, 0.8, 0.8, 0.8), ACROSS),
    "point": Gesture((0.8, 0.8, 0.8, 0.05), ACROSS),
    "pinch": Gesture((0.15, 0.2, 0.3, 0.6), (0.9, 0.6, 0.7, 0.6)),
    "thumb_up": Gesture((0.8, 0.8, 0.8, 0.8), (0.3, 0.0, 0.9, 0.3)),
    "one": Gesture((0.8, 0.8, 0.8, 0.0), BESIDE),
    "two": Gesture((0.8, 0.8, 0.0, 0.0), BESIDE),
    "three": Gesture((0.8, 0.0, 0.0, 0.0), BESIDE),
    "four": Gesture((0.0, 0.0, 0.0, 0.0), ACROSS),
    "five": Gesture((0.0, 0.0, 0.0, 0.0), OUT),
}
DECIMALS = 4  # of poses that are written down
STEPS = 9  # in which a gesture is eased off towards the open hand


def fingers_of(name: str, person: Person, sampler: HandSampler) -> Array:
    """The inputs (D,) of a gesture's fingers, else 0: as far as this person's fingers get without sinking in."""
    opened, formed = (_inputs(gesture, sampler) for gesture in (GESTURES["open"], GESTURES[name]))
    trials = formed + np.linspace(0, 1, STEPS)[:, None] * (opened - formed)
    whole = np.zeros((STEPS, len(person.flesh.whole.initial)))
    whole[:, : trials.shape[1]] = trials
    fits = person.penetration_mm(whole) <= sampler.prior.penetration
    return np.asarray(trials[int(np.argmax(fits)) if fits.any() else -1])


def poses(sampler: HandSampler) -> dict[str, dict[str, float]]:
    """The fingers of every gesture on the skeleton's own hand: inputs by DoF, for whoever offers poses by name."""
    flesh, unit_mm = sampler.flesh, sampler.cube_mm / 2
    person = Person(flesh, flesh.whole.bones, 1.0, flesh.radii, 1.0, (1.0, 0.0), unit_mm)
    limbs = [*sampler.flexions.ravel(), *sampler.spreads, *sampler.thumb]
    names = {int(d): sampler.skeleton.dof_names[int(d)] for d in sorted(limbs)}
    found = {gesture: fingers_of(gesture, person, sampler) for gesture in GESTURES}
    return {
        gesture: {name: round(float(inputs[d]), DECIMALS) + 0.0 for d, name in names.items()}
        for gesture, inputs in found.items()
    }


def _inputs(gesture: Gesture, sampler: HandSampler) -> Array:
    lower, upper = sampler.skeleton.lower, sampler.skeleton.upper
    inputs = np.zeros(len(lower))
    for d, part in zip(sampler.flexions, gesture.bent):
        inputs[d] = upper[d] - part * (upper - lower)[d]
    d = sampler.thumb
    inputs[d] = lower[d] + np.array(gesture.thumb) * (upper - lower)[d]
    return inputs
