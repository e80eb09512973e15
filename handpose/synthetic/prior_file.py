"""The prior file: the distribution of poses, positions and sizes of a body, as text next to its
skeleton file.

``prototxt/hand/nyu_prior.prototxt`` is that of the hand; other bodies have other files. Angles
of ``turn`` are in degrees and of the whole DoF (input + initial); all other values of DoFs are
fractions of the range between the limits of its input, 0 at the lower and 1 at the upper.
Lengths are in mm.

    turn        orientation of the body as a whole: normal, or for a fraction of bodies any angle
    proportion  bones that are longer or shorter together, such as all of a limb
    bend        chains of DoFs that bend together, such as the joints of a limb
    spread      DoFs about their initial value: normal
    between     DoFs anywhere between their limits: Beta
    pose        poses with a name; ``blend`` of all bodies are somewhere between two of them
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handpose.frames.cameras import CAMERAS
from handpose.synthetic.prior_names import Named, expect, expect_known
from handpose.synthetic.prior_parameters import (
    BetaParameter,
    BetweenParameter,
    PosePrior,
    RangeParameter,
)
from layers.hand.skeleton import NYU_HAND
from netlib.errors import PrototxtError
from netlib.files.paths import real
from netlib.proto import prototxt, schema

MAX_DISTANCE_MM = 1e5  # range of depth cameras
MAX_REDRAWS = 1000
NYU_PRIOR = NYU_HAND.with_name("nyu_prior.prototxt")
PEOPLE_PRIOR = NYU_HAND.with_name("people_prior.prototxt")


def load(path: str | Path = NYU_PRIOR) -> PosePrior:
    """The prior of a file; by default that of the NYU hand. Raises PrototxtError, NetlibError."""
    return _load(Path(path), real(path))


@functools.lru_cache(maxsize=16)
def _load(path: Path, whole_path: Path) -> PosePrior:
    tree = prototxt.parse_file(path)
    for field in tree.fields:
        if field.name == "joint":
            advice = f'a prior file, which names it: skeleton: "{path.name}" (docs/bodies.md)'
            raise PrototxtError(field.position, f"found a skeleton; expected {advice}")
    prior = schema.read(tree, PosePrior, f"prior {path}")
    _check(prior)
    return prior


class Bounds(NamedTuple):
    """The lowest and the highest value of a number, and both in words."""

    low: float
    high: float
    in_words: str


ABOVE_ZERO = math.ulp(0.0)
MAX_FINITE = sys.float_info.max
DEVIATION = Bounds(0, MAX_DISTANCE_MM, f"0 or more, up to {MAX_DISTANCE_MM:g}")
DISTANCE = Bounds(
    -MAX_DISTANCE_MM,
    MAX_DISTANCE_MM,
    f"a number between -{MAX_DISTANCE_MM:g} and {MAX_DISTANCE_MM:g}",
)
FRACTION = Bounds(0, 1, "a fraction, 0 to 1")
NOT_NEGATIVE = Bounds(0, math.inf, "0 or more")
# of the fields of these names, in any message
BOUNDS = {
    **dict.fromkeys(("std", "noise", "blend_noise", "scale_std", "bone_std"), DEVIATION),
    **dict.fromkeys(("center_jitter", "center_jitter_wide"), DEVIATION),
    **dict.fromkeys(("mean", "x", "y", "z"), DISTANCE),
    **dict.fromkeys(("most", "scale_clip"), NOT_NEGATIVE),
    **dict.fromkeys(("any", "independent", "wide", "blend"), FRACTION),
    "part": Bounds(0, 1, "a part of the range, 0 to 1"),
    "penetration": Bounds(-math.inf, math.inf, "a depth in mm"),
    "scale_mean": Bounds(ABOVE_ZERO, MAX_DISTANCE_MM, "a factor above 0"),
    "cube_mm": Bounds(ABOVE_ZERO, MAX_FINITE, "a length in mm > 0"),
    "redraws": Bounds(1, MAX_REDRAWS, f"1 to {MAX_REDRAWS}"),
}


def _check(prior: PosePrior) -> None:
    """Raise PrototxtError for invalid numbers and unknown names."""
    expect_known(prior, "camera", prior.camera, CAMERAS)
    for message in messages(prior):
        _check_numbers(message)
    for message, name, mean in (
        (prior, "scale_std", prior.scale_mean),
        (prior, "bone_std", 1.0),
        *((group, "std", 1.0) for group in prior.proportion),
    ):
        std = getattr(message, name)
        are_above = not std or std * prior.scale_clip < mean
        expect(message, name, are_above, "less than 1 / scale_clip, so that none is below 0")
    Named(prior, prior.body())
    alone: list[Any] = [*prior.spread, *prior.between]
    known = [dof for message in alone for dof in message.dof]
    for part in (part for pose in prior.pose for part in pose.at):
        expect_known(part, "of", part.of, known)


def messages(message: Any) -> Iterator[Any]:
    """The message and all messages in it."""
    yield message
    for field in fields(message):
        value = getattr(message, field.name)
        for part in value if isinstance(value, tuple) else (value,):
            if is_dataclass(part):
                yield from messages(part)


def _check_numbers(message: Any) -> None:
    """Check each number of a message alone, and ranges and Beta distributions."""
    for name, bounds in BOUNDS.items():
        value = getattr(message, name, None)
        if value is not None:
            expect(message, name, bounds.low <= value <= bounds.high, bounds.in_words)
    if isinstance(message, RangeParameter):
        is_range = 0 < message.low <= message.high <= MAX_DISTANCE_MM
        expect(message, "low", is_range, f"0 < low <= high <= {MAX_DISTANCE_MM:g}, in mm")
    elif isinstance(message, (BetaParameter, BetweenParameter)):
        expect(message, "a", 0 < message.a < np.inf and 0 < message.b < np.inf, "a and b > 0")
