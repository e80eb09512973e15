"""The networks of the paper's Table 1."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PROTOTXT = Path(__file__).resolve().parents[2] / "prototxt"
SOLVER = PROTOTXT / "nyu_solver.prototxt"


@dataclass(frozen=True)
class Network:
    """One line of the table."""

    name: str
    title: str
    model: Path
    paper: tuple[float, float] | None  # the paper's errors on NYU: of joints in mm, of angles in degrees
    by_fit: bool = False  # its angles are those of a hand fitted to its joints


NETWORKS = (
    Network("direct_joint", "direct joint", PROTOTXT / "table1/direct_joint.prototxt", (17.2, 21.4), by_fit=True),
    Network("direct_parameter", "direct parameter", PROTOTXT / "table1/direct_parameter.prototxt", (26.7, 12.2)),
    Network("no_limit", "ours without PhysLimit", PROTOTXT / "table1/no_limit.prototxt", (16.9, 12.0)),
    Network("ours", "ours", PROTOTXT / "nyu_train_test.prototxt", (16.9, 12.2)),
    Network("bottleneck", "DeepPrior's bottleneck", PROTOTXT / "table1/bottleneck.prototxt", None, by_fit=True),
)
