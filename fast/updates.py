"""SGD and Adam without new arrays: to get one of the size of FC1's weights costs more than the arithmetic.

The rules and their letters are those of netlib/updates.py, the operations and their order the same: so are the bits.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

import numpy as np

from fast.parallel import buffer_of
from netlib.blob import Array
from netlib.proto.messages import SolverParameter
from netlib.updates import Rule

_buffers = threading.local()


def _scratch(g: Array) -> Array:
    """Memory of the calling thread of g's shape."""
    flat = buffer_of(_buffers, f"{g.dtype}{g.size}", (g.size,), g.dtype)
    return flat.reshape(g.shape)


def _sgd(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    [h], step = history, _scratch(g)
    np.multiply(g, rate, out=step)
    h *= p.momentum
    h += step
    w -= h


def _adam(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    (h, q), step = history, _scratch(g)
    correction = math.sqrt(1 - p.momentum2**t) / (1 - p.momentum**t)
    np.multiply(g, 1 - p.momentum, out=step)
    h *= p.momentum
    h += step
    np.multiply(g, g, out=step)
    step *= 1 - p.momentum2
    q *= p.momentum2
    q += step
    np.sqrt(q, out=step)
    step += p.delta
    np.divide(h, step, out=step)
    step *= rate * correction
    w -= step


RULES: dict[str, tuple[Rule, int]] = {"SGD": (_sgd, 1), "Adam": (_adam, 2)}
