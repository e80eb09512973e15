"""What snapshots hold, whatever their format (snapshot_hdf5.py, snapshot_binary.py)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from netlib.blob import Array

Weights = dict[str, dict[int, Array]]  # layer name -> parameter index -> array


@dataclass
class SolverState:
    """What a solver state file holds. Raises ValueError for what no solver has written."""

    iter: int
    current_step: int
    learned_net: str  # path of the weights, as written by the solver
    history: list[Array]
    extra: dict[str, Any] = field(default_factory=dict)  # ours; empty in a file that Caffe wrote

    def __post_init__(self) -> None:
        if not isinstance(self.extra, dict) or min(self.iter, self.current_step) < 0:
            raise ValueError("the state makes no sense")
