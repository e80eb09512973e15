"""A skeleton's inputs under standard names: its free angles and translations, with values and limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from layers.hand.skeleton import Skeleton
from netlib.blob import Array

NO_LIMIT = 9999.0  # rad; the packaged hand stores 10000


class FreeDofs(NamedTuple):
    """The DoFs of a skeleton that are free and move something, as indices.

    angles  that turn a joint, in rad
    slides  the others: they only translate, in the skeleton's units
    """

    angles: list[int]
    slides: list[int]


def free_dofs(skeleton: Skeleton) -> FreeDofs:
    """Both kinds, in the order of the skeleton."""
    angles = np.unique(skeleton.driven[skeleton.turns])
    slides = np.setdiff1d(skeleton.driven, angles)
    return FreeDofs(angles.tolist(), slides.tolist())


def limits(skeleton: Skeleton, dof: int) -> tuple[float | None, float | None]:
    """Lowest and highest value of an angle in rad, input plus initial value; None without a limit."""
    initial = float(skeleton.initial[dof])
    lower, upper = float(skeleton.lower[dof]), float(skeleton.upper[dof])
    return (lower + initial if lower > -NO_LIMIT else None), (upper + initial if upper < NO_LIMIT else None)


def inputs_of(skeleton: Skeleton, dofs: FreeDofs, angles: Array, slides: Array) -> Array:
    """Inputs (D,) from the values of the free DoFs; inputs that move nothing are 0."""
    values = skeleton.initial.copy()
    values[dofs.angles], values[dofs.slides] = angles, slides
    return np.asarray(values - skeleton.initial)
