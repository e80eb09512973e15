"""Content of snapshots, independent of the file format (hdf5_format.py, binary_format.py)."""

from __future__ import annotations

import json
import math
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from netlib.blob import Array

Weights = dict[str, dict[int, Array]]  # layer name -> parameter index -> array

MAX_ITERATIONS = 2**31 - 1  # Caffe counts in 32 bits
# Fields of ``extra`` and their types; states of earlier versions lack some.
EXTRA: dict[str, type] = {
    "solver": dict, "smoothed": list, "layers": list, "ranks": list, "weights_crc": int, "checksum": int,
}


@dataclass
class SolverState:
    """Content of a solver state file."""

    iter: int
    current_step: int
    learned_net: str  # path of the weights, as written by the solver
    history: list[Array]
    extra: dict[str, Any] = field(default_factory=dict)  # see EXTRA; empty if Caffe wrote the file

    def checksum(self) -> int:
        """CRC-32 of the state without the checksum itself."""
        extra = {name: value for name, value in self.extra.items() if name != "checksum"}
        text = json.dumps([self.iter, self.current_step, self.learned_net, extra], sort_keys=True)
        crc = zlib.crc32(text.encode())
        for array in self.history:
            crc = zlib.crc32(f"{array.dtype.str}{array.shape}".encode(), crc)
            crc = zlib.crc32(np.ascontiguousarray(array).data, crc)
        return crc

    def check(self) -> None:
        """Raise ValueError, with a description, if no solver can have written this state."""
        for name in ("iter", "current_step"):
            if not 0 <= getattr(self, name) <= MAX_ITERATIONS:
                raise ValueError(f"{name} is {getattr(self, name)}")
        for i, array in enumerate(self.history):
            if array.dtype.kind != "f":
                raise ValueError(f"history {i} holds {array.dtype}, expected floating-point numbers")
            if not np.isfinite(array).all():
                raise ValueError(f"history {i} has values that are not finite")
        if not isinstance(self.extra, dict):
            raise ValueError("field 'netlib' must be a JSON object")
        for name, value in self.extra.items():
            if name not in EXTRA or type(value) is not EXTRA[name]:
                raise ValueError(f"{name!r} is {type(value).__name__}, expected {', '.join(EXTRA)}")
        if not all(type(loss) is float and math.isfinite(loss) for loss in self.extra.get("smoothed", ())):
            raise ValueError("'smoothed' must hold finite numbers only")
        for name in ("layers", "ranks"):
            for states in self.extra.get(name, ()):
                if type(states) is not dict or not all(type(state) is dict for state in states.values()):
                    raise ValueError(f"{name!r} must hold states of layers only")
        if "checksum" in self.extra and self.extra["checksum"] != self.checksum():
            raise ValueError("checksum mismatch")


def contradictions(state: SolverState, course: Mapping[str, Any], steps: int) -> Iterator[str]:
    """Describe inconsistencies in a state that has a checksum, and therefore all fields of this version.

    course  current values of the solver options that are in ``extra``
    steps   value of ``current_step`` with these options
    """
    extra = state.extra
    if "checksum" not in extra:
        return
    for name in EXTRA:
        if name not in extra and name != "ranks":
            yield f"it has no {name!r}, but a checksum"
    named = re.search(r"_iter_(\d+)\.caffemodel(\.h5)?$", state.learned_net)
    if named and named[1] != str(state.iter):
        yield f"iter is {state.iter}, but its weights are {state.learned_net!r}"
    if len(extra["smoothed"]) > state.iter:
        yield f"iter is {state.iter}, but 'smoothed' holds {len(extra['smoothed'])} losses"
    then = extra["solver"]
    for name, value in then.items():
        if name in course and _kind(value) != _kind(course[name]):
            yield f"the solver's {name} is {value!r}"
    ranks, states = then.get("ranks", 1), 1 + len(extra.get("ranks", []))
    if ranks != states:
        yield f"ranks is {ranks}, but there are states of {states}"
    same_steps = all(then.get(name) == course[name] for name in ("lr_policy", "stepsize", "stepvalue"))
    if same_steps and state.current_step != steps:
        yield f"current_step is {state.current_step}, but {steps} at iter {state.iter}"


def _kind(value: Any) -> str:
    return "number" if type(value) in (int, float) else type(value).__name__
