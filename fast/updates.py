"""SGD and Adam without temporary arrays: a new array of the size of FC1's weights costs more than the arithmetic.

The rules and their letters are those of netlib/updates.py; the operations and their order are the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from netlib.blob import Array
from netlib.schema import SolverParameter
from netlib.updates import RULES as PLAIN_RULES
from netlib.updates import Rule


def _sgd(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    [h] = history
    h *= p.momentum
    g *= rate
    h += g
    w -= h


def _adam(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    m, v = history
    correction = math.sqrt(1 - p.momentum2**t) / (1 - p.momentum**t)
    step = g * (1 - p.momentum)  # one array for all that is passing
    m *= p.momentum
    m += step
    np.multiply(g, g, out=step)
    step *= 1 - p.momentum2
    v *= p.momentum2
    v += step
    np.sqrt(v, out=step)
    step += p.delta
    np.divide(m, step, out=step)
    step *= rate * correction
    w -= step


RULES: dict[str, tuple[Rule, int]] = {**PLAIN_RULES, "SGD": (_sgd, 1), "Adam": (_adam, 2)}
