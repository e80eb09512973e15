"""Content of snapshots, independent of the file format (hdf5_format.py, binary_format.py)."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from netlib.blob import Array

Weights = dict[str, dict[int, Array]]  # layer name -> parameter index -> array

MAX_ITERATIONS = 2**31 - 1  # Caffe counts in 32 bits
# Fields beyond Caffe's; states of earlier versions lack some.
EXTRA = ("solver", "smoothed", "layers", "stores_all", "ranks", "weights_crc", "checksum")


@dataclass
class SolverState:
    """Content of a solver state file."""

    iter: int
    current_step: int
    learned_net: str  # path of the weights, as written by the solver
    history: list[Array]
    # of netlib (training/resume.py); empty if Caffe wrote the file
    extra: dict[str, Any] = field(default_factory=dict)

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
                raise ValueError(
                    f"history {i} holds {array.dtype}, expected floating-point numbers"
                )
            if not np.isfinite(array).all():
                raise ValueError(f"history {i} has values that are not finite")
        if not isinstance(self.extra, dict):
            raise ValueError("field 'netlib' must be a JSON object")
        # a damaged name of 'checksum' would disable its check
        if unknown := sorted(set(self.extra) - set(EXTRA)):
            raise ValueError(f"found {unknown[0]!r}, expected {', '.join(EXTRA)}")
        if "checksum" in self.extra and self.extra["checksum"] != self.checksum():
            raise ValueError("checksum mismatch")
