"""The compared networks: those of the paper's Table 1, and further ones for open questions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

from experiments.table1.settings import Setting
from netlib.files.paths import ROOT

PROTOTXT = ROOT / "prototxt"


class Published(NamedTuple):
    """The paper's numbers for a network on NYU (Table 1), by the names of ``store.Figures``."""

    error_14_mm: float
    fitted_angle_deg: float
    out_of_limits: float = math.nan  # fraction of the frames


@dataclass(frozen=True)
class Network:
    """One line of the table.

    labels  the angles that it learns from: those of a hand fitted to the joints, as in the paper, or the exact ones
    limit   loss_weight and norm of its PhysLimit, if not those of its file
    people  True if it gets or predicts the hand's size; only for settings in which hands differ
    """

    name: str
    title: str
    model: Path
    paper: Published | None = None
    by_fit: bool = False  # its angles are those of a hand fitted to its joints
    labels: Literal["fitted", "exact"] | None = None
    limit: tuple[float, str] | None = None
    people: bool = False

    def is_for(self, setting: Setting) -> bool:
        """True if the setting has the data that it needs."""
        return (setting.has_exact_angles or self.labels != "exact") and (setting.has_many_people or not self.people)


OURS = Network("ours", "ours", PROTOTXT / "nyu_train_test.prototxt", Published(16.9, 12.2, 0.009))
NO_LIMIT = Network("no_limit", "ours without PhysLimit", PROTOTXT / "table1/no_limit.prototxt",
                   Published(16.9, 12.0, 0.186))
DIRECT_JOINT = Network("direct_joint", "direct joint", PROTOTXT / "table1/direct_joint.prototxt",
                       Published(17.2, 21.4), by_fit=True)
NETWORKS = (
    DIRECT_JOINT,
    Network("direct_parameter", "direct parameter", PROTOTXT / "table1/direct_parameter.prototxt",
            Published(26.7, 12.2), labels="fitted"),
    NO_LIMIT,
    OURS,
    Network("bottleneck", "DeepPrior's bottleneck", PROTOTXT / "table1/bottleneck.prototxt", by_fit=True),
    Network("direct_parameter_exact", "direct parameter, exact angles", PROTOTXT / "table1/direct_parameter.prototxt",
            labels="exact"),
    Network("ours_scale", "ours with predicted size", PROTOTXT / "table1/ours_scale.prototxt", people=True),
    Network("ours_bones", "ours with given bones", PROTOTXT / "table1/ours_bones.prototxt", people=True),
)


def limited(weight: float, norm: str) -> Network:
    """Ours with another weight lambda and norm of PhysLimit; 0 is without it, and 1 with the norm L1 is ours."""
    if weight == 0:
        return NO_LIMIT
    if (weight, norm) == (1, "L1"):
        return OURS
    return replace(OURS, name=f"ours_{norm.lower()}_{weight:g}", title=f"ours, λ = {weight:g}, {norm}", paper=None,
                   limit=(weight, norm))


LAMBDAS = tuple(limited(weight, norm) for norm, weights in (("L1", (0, 0.01, 0.1, 1, 10)), ("L2", (0.1, 1, 10)))
                for weight in weights)
