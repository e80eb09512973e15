"""Data of docs/momentum.html: paths of SGD with momentum down ½ (x² + 9 y²), and roots of the recurrence."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.learning import START, STEEP, path_of

RATES = [round(0.025 * n, 3) for n in range(1, 19)]  # to 0.45, beyond 2 (1 + m) / 9 for every momentum
MOMENTA = [round(0.05 * n, 2) for n in range(20)]
DIGITS = 4


def data() -> dict[str, Any]:
    """``paths[momentum][rate]``: the x of all steps, then the y. ``roots[momentum][rate][x or y]``: two [re, im]."""
    return {
        "start": START, "steep": STEEP.tolist(), "rates": RATES, "momenta": MOMENTA,
        "paths": [[_path(rate, momentum) for rate in RATES] for momentum in MOMENTA],
        "roots": [[[roots(rate * steep, momentum) for steep in STEEP] for rate in RATES] for momentum in MOMENTA],
    }  # fmt: skip


def roots(rate: float, momentum: float) -> list[list[float]]:
    """The roots of z² - (1 + m - rate) z + m, the larger one first: errors shrink by its absolute value in a step."""
    found = sorted(np.roots([1, -(1 + momentum - rate), momentum]), key=lambda z: (-round(abs(z), 9), -z.imag))
    return [[_rounded(z.real), _rounded(z.imag)] for z in found]


def _path(rate: float, momentum: float) -> list[list[float]]:
    places = path_of("SGD", base_lr=rate, momentum=momentum)
    return [[_rounded(value) for value in column] for column in places.T]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}") + 0.0
