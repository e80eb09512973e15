"""Poses of the prior file with a name, as far as a person's fingers can go."""

from __future__ import annotations

import numpy as np

from handpose.sequences.person import Person
from handpose.synthetic.pose_prior import BodySampler
from netlib.blob import Array

OPEN = "open"  # towards which a gesture is eased off
STEPS = 9  # in so many
DECIMALS = 4  # of poses that are written down


def fingers_of(name: str, person: Person, sampler: BodySampler) -> Array:
    """The inputs (D,) of a gesture's fingers, else 0: as far as this person's fingers get without sinking in."""
    opened, formed = sampler.poses[OPEN], sampler.poses[name]
    trials = formed + np.linspace(0, 1, STEPS)[:, None] * (opened - formed)
    whole = np.zeros((STEPS, len(person.flesh.whole.initial)))
    whole[:, : trials.shape[1]] = trials
    fits = person.penetration_mm(whole) <= sampler.prior.penetration
    return np.asarray(trials[int(np.argmax(fits)) if fits.any() else -1])


def poses(sampler: BodySampler) -> dict[str, dict[str, float]]:
    """The limbs of every pose on the skeleton's own body: inputs by DoF, for whoever offers poses by name."""
    flesh, unit_mm = sampler.flesh, sampler.cube_mm / 2
    person = Person(flesh, flesh.whole.bones, 1.0, flesh.radii, 1.0, (1.0, 0.0), unit_mm, sampler.center)
    names = {int(d): sampler.skeleton.dof_names[int(d)] for d in sampler.limbs}
    found = {name: fingers_of(name, person, sampler) for name in sampler.poses}
    return {
        pose: {name: round(float(inputs[d]), DECIMALS) + 0.0 for d, name in names.items()}
        for pose, inputs in found.items()
    }
