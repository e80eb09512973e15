"""Named poses, of the prior file and of the gestures that are recognised, within the reach of the fingers."""

from __future__ import annotations

import numpy as np

from handpose.sequences.person import Person
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_file import PartParameter, PoseParameter
from netlib.blob import Array

OPEN = "open"  # the pose towards which a gesture is relaxed
STEPS = 9  # number of steps
DECIMALS = 4  # decimals of written poses


def fingers_of(name: str, person: Person, sampler: BodySampler) -> Array:
    """The inputs (D,) of a gesture's fingers, otherwise 0, as far as this person's fingers move without penetration."""
    opened, formed = sampler.poses[OPEN], sampler.poses[name]
    trials = formed + np.linspace(0, 1, STEPS)[:, None] * (opened - formed)
    whole = np.zeros((STEPS, len(person.surface.whole.initial)))
    whole[:, : trials.shape[1]] = trials
    fits = person.penetration_mm(whole) <= sampler.prior.penetration
    return np.asarray(trials[int(np.argmax(fits)) if fits.any() else -1])


def poses(sampler: BodySampler) -> dict[str, dict[str, float]]:
    """The limbs of every pose on the skeleton's own body: inputs by DoF."""
    surface, unit_mm = sampler.surface, sampler.cube_mm / 2
    person = Person(surface, surface.whole.bones, 1.0, surface.radii, 1.0, (1.0, 0.0), unit_mm, sampler.center)
    names = {int(d): sampler.skeleton.dof_names[int(d)] for d in sampler.limbs}
    found = {name: fingers_of(name, person, sampler) for name in sampler.poses}
    return {
        pose: {name: round(float(inputs[d]), DECIMALS) + 0.0 for d, name in names.items()}
        for pose, inputs in found.items()
    }


# The gestures in the recordings on which recognition is measured. Unlike the poses of the prior files, about which
# training data are drawn, the thumb is out or across the palm as in the gesture's definition, and a pinch touches.
_OUT = {"thumb_pip_rot_y": 0.5, "thumb_pip_rot_z": 0.1, "thumb_dip_rot_z": 0.7, "thumb_tip_rot_z": 0.4}
_ACROSS = {"thumb_pip_rot_y": 0.3, "thumb_pip_rot_z": 0.75, "thumb_dip_rot_z": 0.8, "thumb_tip_rot_z": 0.3}
_FOLDED = {"thumb_pip_rot_y": 0.7, "thumb_pip_rot_z": 0.72, "thumb_dip_rot_z": 0.97, "thumb_tip_rot_z": 0.94}
_TOUCHING = {
    "thumb_pip_rot_y": 0.39, "thumb_pip_rot_z": 0.57, "thumb_dip_rot_z": 0.68, "thumb_tip_rot_z": 0.59,
    "index_base_rot_x": 0.58, "index_base_rot_z": 0.46, "index_pip_rot_x": 0.33, "index_dip_rot_x": 0.33,
}


def _pose(name: str, bends: tuple[float, float, float, float], at: dict[str, float]) -> PoseParameter:
    """A pose: the bends of index to little finger with their knuckles, and DoFs as fractions of their ranges."""
    bent = [
        PartParameter(chain, bend)
        for of, bend in zip(("index", "middle", "ring", "little"), bends)
        for chain in (of, f"{of}_knuckle")
        if bend >= 0
    ]
    return PoseParameter(name, tuple(bent), tuple(PartParameter(of, part) for of, part in at.items()))


SHOWN = (
    _pose("open", (0.12, 0.12, 0.12, 0.12), _OUT),
    _pose("fist", (0.8, 0.8, 0.8, 0.8), _FOLDED),
    _pose("point", (0.1, 0.8, 0.8, 0.8), _FOLDED),
    _pose("pinch", (-1, 0.2, 0.15, 0.1), _TOUCHING),
    _pose("thumb_up", (0.8, 0.8, 0.8, 0.8), _OUT),
    _pose("two", (0.1, 0.1, 0.8, 0.8), _FOLDED),
    _pose("three", (0.1, 0.1, 0.1, 0.8), _FOLDED),
    _pose("four", (0.1, 0.1, 0.1, 0.1), _ACROSS),
)
