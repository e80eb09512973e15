"""Train the networks of Table 1 in resumable steps.

A training is a network in a setting, with a recipe and a seed. Its trunk runs to the iteration where a length branches
off; then the end of that length is trained from there, with separate snapshots (see recipes.py). Its files:

    ours_paper_seed1_net.prototxt           the net
    ours_paper_seed1_trunk_iter_3600...     the trunk's snapshots
    ours_paper_seed1_of4000_iter_4000...    the end of 4,000 iterations
    ours_paper_seed1.times.json             measured seconds
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.table1 import true_angles
from experiments.table1.derived_nets import net_of, write_components
from experiments.table1.networks import Network
from experiments.table1.recipes import Recipe
from experiments.table1.settings import Setting
from handpose.datasets import parts
from netlib.files import atomic

STATE, WEIGHTS = ".solverstate.h5", ".caffemodel.h5"


@dataclass(frozen=True)
class Step:
    """One call of the solver, as files: a part of a trunk, or of an end."""

    solver: Path
    log: Path
    prefix: Path  # prefix of its snapshots
    first: int  # the iteration to resume at
    last: int  # last iteration
    snapshot: Path | None = None  # to resume from
    weights: Path | None = None  # initial weights

    def __str__(self) -> str:
        options = {"snapshot": self.snapshot, "weights": self.weights}
        return " ".join([str(self.solver), *(f"--{name} {path}" for name, path in options.items() if path)])


@dataclass(frozen=True)
class Training:
    """A network in a setting, by a recipe, from a seed; its files are in the folder ``work``."""

    setting: Setting
    network: Network
    recipe: Recipe
    seed: int
    work: Path

    @property
    def name(self) -> str:
        """The prefix of its files."""
        return f"{self.network.name}_{self.recipe.name}_seed{self.seed}"

    @property
    def net(self) -> Path:
        """The net's file."""
        return self.work / f"{self.name}_net.prototxt"

    def weights_of(self, iterations: int) -> Path:
        """The weights at the end of this length."""
        return _at(self._end(iterations), iterations, WEIGHTS)

    def next_step(self, iterations: int, files: Sequence[Path]) -> Step | None:
        """The next step towards a length, with its files written; None if the length is done.

        files  the training frames
        """
        end, trunk, branch = self._end(iterations), self._trunk, self.recipe.branch(iterations)
        if _at(end, iterations, STATE).is_file():
            return None
        atomic.replace_text(self.net, str(net_of(self.network, self.setting, self.recipe)))
        if states := _states(end):
            return self._step(end, iterations, states[-1])
        before = [state for state in _states(trunk) if iteration_of(state) <= branch]
        if before and iteration_of(before[-1]) == branch:
            return self._step(end, iterations, before[-1])
        if before:
            return self._step(trunk, branch, before[-1])
        weights = None
        if self.network.name == "bottleneck":
            weights = self.work / "principal_components.caffemodel.h5"
            write_components(weights, files)
        return self._step(trunk, branch, None, weights)

    def _step(self, prefix: Path, last: int, snapshot: Path | None, weights: Path | None = None) -> Step:
        """A step with its solver's file."""
        first = iteration_of(snapshot) if snapshot else 0
        own = {"net": self.net, "max_iter": last, "display": 100, "snapshot": self.recipe.every,
               "snapshot_format": "HDF5", "snapshot_prefix": prefix, "random_seed": self.seed}
        tree = self.recipe.trunk(own) if prefix == self._trunk else self.recipe.ending(last, own)
        solver = Path(f"{prefix}_solver.prototxt")
        atomic.replace_text(solver, str(tree))
        return Step(solver, Path(f"{prefix}_from_{first}.log"), prefix, first, last, snapshot, weights)

    @property
    def _trunk(self) -> Path:
        return self.work / f"{self.name}_trunk"

    def _end(self, iterations: int) -> Path:
        return self.work / f"{self.name}_of{iterations}"

    # ------------------------------------------------------------------------------------------ removal

    def forget_older(self, step: Step, iteration: int) -> None:
        """Remove the snapshots of a step's prefix from before an iteration."""
        for state in _states(step.prefix):
            if iteration_of(state) < iteration:
                _remove(state)

    def forget_end(self, iterations: int) -> None:
        """Remove the snapshots of the end of a length, which has been scored."""
        for state in _states(self._end(iterations)):
            _remove(state)

    # ------------------------------------------------------------------------------------------ durations

    def add_time(self, step: Step, iterations: int, seconds: float) -> None:
        """Record the duration of some iterations of a step."""
        times = self._times()
        done, spent = times.get(step.prefix.name, (0, 0.0))
        times[step.prefix.name] = (done + iterations, spent + seconds)
        atomic.replace_text(self._clock, json.dumps(times))

    def seconds(self, iterations: int) -> float:
        """The duration of a length, trunk and end, as measured; a part without a measurement has the other's rate."""
        times, branch = self._times(), self.recipe.branch(iterations)
        measured = [times.get(prefix.name, (0, 0.0)) for prefix in (self._trunk, self._end(iterations))]
        rates = [spent / done for done, spent in measured if done]
        return branch * rates[0] + (iterations - branch) * rates[-1] if rates else 0.0

    @property
    def _clock(self) -> Path:
        return self.work / f"{self.name}.times.json"

    def _times(self) -> dict[str, tuple[int, float]]:
        """Iterations and seconds of each prefix; unreadable entries are unknown."""
        try:
            found = json.loads(atomic.text_of(self._clock) or "{}")
            return {str(name): (int(done), float(spent)) for name, (done, spent) in found.items()}
        except (ValueError, TypeError, AttributeError):
            return {}


def data_name(files: Sequence[Path]) -> str:
    """A folder name for training data: where they are from, and a checksum of all that they depend on."""
    facts = [(path.name, path.stat().st_size, parts.attributes(path) or {}) for path in files]
    origin = str(facts[0][2].get("made_from", "unknown")).lower()
    recipes = "\n".join(f"{name} {found.get('recipe', size)}" for name, size, found in facts)
    return f"{re.sub(r'[^a-z0-9]+', '_', origin)}_{zlib.crc32(recipes.encode()):08x}"


def work_folder(work: Path, setting: Setting, data: str, network: Network) -> Path:
    """The folder of a network's training runs; other data or labels have another folder."""
    labels = f"_{true_angles.RECIPE}" if network.labels == "fitted" else ""
    return work / f"{setting.name}_{data}{labels}"


def iteration_of(state: Path) -> int:
    """The iteration of a snapshot."""
    return int(re.findall(r"_iter_(\d+)\.", state.name)[-1])


def _at(prefix: Path, iteration: int, suffix: str) -> Path:
    return Path(f"{prefix}_iter_{iteration}{suffix}")


def _states(prefix: Path) -> list[Path]:
    """The snapshots of a prefix, by their iterations; the state is the file of a snapshot that is written last."""
    found = [path for path in prefix.parent.glob("*" + STATE) if path.name.startswith(f"{prefix.name}_iter_")]
    return sorted(found, key=iteration_of)


def _remove(state: Path) -> None:
    """Remove a snapshot, the state first, because the weights are useless without it."""
    state.unlink(missing_ok=True)
    state.with_name(state.name.replace(STATE, WEIGHTS)).unlink(missing_ok=True)
