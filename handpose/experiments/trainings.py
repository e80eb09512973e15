"""How the networks of Table 1 are trained: with the paper's solver, from random weights or where a run was stopped."""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from handpose.data import parts
from handpose.experiments import true_angles
from handpose.experiments.networks import SOLVER, Network
from handpose.experiments.principal_components import write_components
from handpose.experiments.solver_text import with_fields
from netlib import atomic


@dataclass(frozen=True)
class Training:
    """One training, as files."""

    solver: Path
    log: Path
    final: Path  # the weights in the end
    snapshot: Path | None = None  # where it goes on
    weights: Path | None = None  # what it starts from

    def __str__(self) -> str:
        options = {"snapshot": self.snapshot, "log": self.log, "weights": self.weights}
        return " ".join([str(self.solver), *(f"--{name} {path}" for name, path in options.items() if path)])


def data_name(files: Sequence[Path]) -> str:
    """A folder name for training data: where they are from, and a checksum of all that they depend on."""
    facts = [(path.name, path.stat().st_size, parts.attributes(path) or {}) for path in files]
    origin = str(facts[0][2].get("made_from", "unknown")).lower()
    recipes = "\n".join(f"{name} {found.get('recipe', size)}" for name, size, found in facts)
    return f"{re.sub(r'[^a-z0-9]+', '_', origin)}_{zlib.crc32(recipes.encode()):08x}"


def training_of(network: Network, files: Sequence[Path], work: Path, iterations: int, seed: int) -> Training:
    """The training of a network on the data in ``files``, with its solver and first weights written into ``work``.

    It goes on from the last snapshot, if there is one. If the file ``final`` is there, nothing is left to be done.
    """
    labels = f"_{true_angles.RECIPE}" if network.name == "direct_parameter" else ""
    prefix = work / f"{network.name}{labels}_seed{seed}_of{iterations}"
    solver, log = Path(f"{prefix}.prototxt"), Path(f"{prefix}.log")
    final = Path(f"{prefix}_iter_{iterations}.caffemodel.h5")
    if final.is_file():
        return Training(solver, log, final)
    atomic.replace_text(solver, solver_text(network, prefix, iterations, seed))
    states = list(work.glob(f"{prefix.name}_iter_*.solverstate.h5"))  # the last file of a snapshot to be written
    if states:
        latest = max(states, key=iteration_of)
        return Training(solver, Path(f"{prefix}_from_{iteration_of(latest)}.log"), final, snapshot=latest)
    if network.name != "bottleneck":
        return Training(solver, log, final)
    weights = work / "principal_components.caffemodel.h5"
    write_components(weights, files)
    return Training(solver, log, final, weights=weights)


def iteration_of(state: Path) -> int:
    """The iteration of a snapshot."""
    return int(re.findall(r"_iter_(\d+)\.", state.name)[-1])


def solver_text(network: Network, prefix: Path, iterations: int, seed: int) -> str:
    """The paper's solver for a network: its own text, with these iterations, no tests, and five snapshots."""
    own = {
        "net": network.model,
        "stepvalue": max(1, iterations * 9 // 10),
        "max_iter": iterations,
        "display": 100,
        "snapshot": max(1, iterations // 5),
        "snapshot_format": "HDF5",
        "snapshot_prefix": prefix,
        "random_seed": seed,
    }
    return with_fields(SOLVER.read_text(encoding="utf-8"), own)
