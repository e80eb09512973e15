"""Figures of chapter 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawn import new_figure
from docs.making.palette import FIRST, SECOND

PLACES = 31  # between 0.5 and 1; at one place alone rounding errors may cancel


def differences() -> Any:
    """The error of a difference quotient over its step, in float32 and float64."""
    figure = new_figure(7.5, 3.6)
    axes = figure.add_subplot()
    for dtype, colour in ((np.float64, FIRST), (np.float32, SECOND)):
        steps = np.logspace(-12 if dtype is np.float64 else -7, 0, 100)
        for kind, style in (("central", "-"), ("one-sided", ":")):
            errors = [error(dtype, h, kind) for h in steps]
            axes.loglog(steps, errors, style, color=colour, label=f"{kind}, {dtype.__name__}", lw=1.2)
    axes.set_xlabel("step h")
    axes.set_ylabel("relative error")
    axes.set_title(f"the slope of x³ by differences, the worst of {PLACES} places between ½ and 1")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def error(dtype: Any, h: float, kind: str) -> float:
    """How far a difference quotient of x³ is from 3x², relative to it: the worst of all places."""
    places = [dtype(x) for x in np.linspace(0.5, 1, PLACES)]
    return max(abs(quotient(dtype, x, h, kind) / (3 * float(x) ** 2) - 1) for x in places)


def quotient(dtype: Any, x: Any, h: float, kind: str) -> float:
    """A difference quotient of x * x * x, computed in ``dtype``: products are the same on every machine."""
    step = dtype(h)
    above, below = x + step, x - step if kind == "central" else x
    width = step + step if kind == "central" else step
    return float((above * above * above - below * below * below) / width)
