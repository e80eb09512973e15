"""The kinematics of a skeleton in the current engine, for computations outside a net."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton
from netlib import engine
from netlib.engine import Engine


def kinematics_of(skeleton: Skeleton, dtype: DTypeLike = np.float64) -> Kinematics:
    """Return the kinematics of a skeleton; cached, so equal arguments give the same object."""
    return _made(engine.get(), skeleton, np.dtype(dtype))


@functools.lru_cache(maxsize=64)
def _made(engine_in_use: Engine, skeleton: Skeleton, dtype: np.dtype[Any]) -> Kinematics:
    return engine_in_use.implementation(Kinematics)(skeleton, dtype)
