"""What snapshots hold, whatever their format (snapshot_hdf5.py, snapshot_binary.py)."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from netlib.blob import Array

Weights = dict[str, dict[int, Array]]  # layer name -> parameter index -> array

MOST_ITERATIONS = 2**31 - 1  # Caffe counts them in 32 bits
# What ``extra`` holds, and of which type; a state of an earlier version may lack some.
EXTRA: dict[str, type] = {
    "solver": dict, "smoothed": list, "layers": list, "ranks": list, "weights_crc": int, "checksum": int,
}  # fmt: skip


@dataclass
class SolverState:
    """What a solver state file holds."""

    iter: int
    current_step: int
    learned_net: str  # path of the weights, as written by the solver
    history: list[Array]
    extra: dict[str, Any] = field(default_factory=dict)  # ours, see EXTRA; empty in a file that Caffe wrote

    def checksum(self) -> int:
        """CRC-32 of everything in the state but the checksum itself."""
        extra = {name: value for name, value in self.extra.items() if name != "checksum"}
        text = json.dumps([self.iter, self.current_step, self.learned_net, extra], sort_keys=True)
        crc = zlib.crc32(text.encode())
        for array in self.history:
            crc = zlib.crc32(f"{array.dtype.str}{array.shape}".encode(), crc)
            crc = zlib.crc32(np.ascontiguousarray(array).data, crc)
        return crc

    def check(self) -> None:
        """Raise ValueError, which says what is wrong, for what no solver has written."""
        for name in ("iter", "current_step"):
            if not 0 <= getattr(self, name) <= MOST_ITERATIONS:
                raise ValueError(f"{name} is {getattr(self, name)}")
        for i, array in enumerate(self.history):
            if array.dtype.kind != "f":
                raise ValueError(f"history {i} holds {array.dtype}, expected floating-point numbers")
            if not np.isfinite(array).all():
                raise ValueError(f"history {i} has values that are not finite")
        if not isinstance(self.extra, dict):
            raise ValueError("what is ours in it is no table")
        for name, value in self.extra.items():
            if name not in EXTRA or type(value) is not EXTRA[name]:
                raise ValueError(f"{name!r} is {type(value).__name__}, expected {', '.join(EXTRA)}")
        if not all(type(loss) is float and math.isfinite(loss) for loss in self.extra.get("smoothed", ())):
            raise ValueError("'smoothed' holds other things than finite numbers")
        for name in ("layers", "ranks"):
            for states in self.extra.get(name, ()):
                if type(states) is not dict or not all(type(state) is dict for state in states.values()):
                    raise ValueError(f"{name!r} holds other things than the states of layers")
        if "checksum" in self.extra and self.extra["checksum"] != self.checksum():
            raise ValueError("its checksum is another than that of its content")
