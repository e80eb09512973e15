"""Figures of chapter 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawn import new_figure


def differences() -> Any:
    """The error of a difference quotient over its step, in float32 and float64."""
    figure = new_figure(7.5, 3.6)
    axes = figure.add_subplot()
    for dtype, colour in ((np.float64, "tab:blue"), (np.float32, "tab:orange")):
        steps = np.logspace(-12 if dtype is np.float64 else -7, 0, 100)
        for kind, style in (("central", "-"), ("one-sided", ":")):
            errors = [abs(quotient(dtype, h, kind) - np.exp(1.0)) / np.exp(1.0) for h in steps]
            axes.loglog(
                steps, np.maximum(errors, 1e-16), style, color=colour, label=f"{kind}, {dtype.__name__}", lw=1.2
            )
    axes.set_xlabel("step h")
    axes.set_ylabel("relative error")
    axes.set_title("the slope of x³ at 1, by differences")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def quotient(dtype: Any, h: float, kind: str) -> float:
    """A difference quotient of x * x * x at 1, computed in ``dtype``: products are the same on every machine."""
    x, step = dtype(1), dtype(h)
    above, below = x + step, x - step if kind == "central" else x
    return float((above * above * above - below * below * below) / (above - below))
