"""What a predictor can be asked for."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Literal, get_args

from handpose.facts.cubes import CUBES_MM
from handpose.facts.sides import SOUGHT_SIDES
from netlib.errors import NetlibError, did_you_mean

Fit = Literal["no", "fast", "accurate"]

MOST_REFINE = 100  # a crop that has not come to rest after so many moves goes round in a circle


def check_options(*, cube_mm: float | None, hand: str, refine: int, fit: str) -> None:
    """Raise NetlibError for options of a ``Predictor`` that are none."""
    for name, word, known in (("hand", hand, SOUGHT_SIDES), ("fit", fit, get_args(Fit))):
        if word not in known:
            raise NetlibError(f"{name}={word!r}{did_you_mean(str(word), known)}; expected {', '.join(known)}")
    least, most = CUBES_MM
    if cube_mm is not None and not (isinstance(cube_mm, Real) and least <= cube_mm <= most):
        raise NetlibError(f"cube_mm={cube_mm!r}; expected {least:g} to {most:g} mm")
    check_whole("refine", refine, 0, MOST_REFINE)


def check_whole(name: str, value: object, least: int, most: int) -> None:
    """Raise NetlibError for a value of an argument that is no whole number from ``least`` to ``most``."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) <= most:
        raise NetlibError(f"{name}={value!r}; expected a whole number from {least} to {most}")
