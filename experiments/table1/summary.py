"""Means and spreads over the seeds of a training run, for the page of Table 1."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.table1.networks import Network
from experiments.table1.plan import Convergence, Job, convergence_of, of_job
from experiments.table1.recipes import Recipe
from experiments.table1.settings import Setting
from experiments.table1.store import Entry, Figures


@dataclass(frozen=True)
class Line:
    """A network by a recipe in a setting.

    by_seed  of its seeds
    """

    network: Network
    by_seed: dict[int, Convergence]

    def values(self, figure: str, subject: str | None = None, *, before: bool = False) -> dict[int, float]:
        """The values of a score for each seed, over all test frames or for one subject; seeds without it are left out.

        before  the score at the previous length
        """
        entries = {seed: v.before if before else v.counts for seed, v in self.by_seed.items()}
        found = {seed: value_of(entry, figure, subject) for seed, entry in entries.items() if entry}
        return {seed: value for seed, value in found.items() if math.isfinite(value)}

    @property
    def lengths(self) -> list[int]:
        """The lengths that count, without repetition."""
        return sorted({v.counts.iterations for v in self.by_seed.values() if v.counts})

    @property
    def ends(self) -> list[str]:
        """How the training runs ended, without repetition."""
        return sorted({v.end for v in self.by_seed.values()})


def value_of(entry: Entry, figure: str, subject: str | None = None) -> float:
    """A figure of ``Figures`` over all test frames of an entry, or over one subject's; NaN if it has none."""
    parts = [part for part in entry.subjects if subject in (None, part.subject)]
    return mean_of(parts, figure)


def mean_of(parts: Sequence[Figures], figure: str) -> float:
    """The mean of a figure over subjects, each with the weight of its frames."""
    if not parts:
        return math.nan
    return float(np.average([getattr(part, figure) for part in parts], weights=[part.frames for part in parts]))


def curve_of(entries: Iterable[Entry], figure: str) -> list[float]:
    """The mean of a figure that is a list, over all test frames and all entries."""
    rows = [np.average([getattr(part, figure) for part in entry.subjects], axis=0,
                       weights=[part.frames for part in entry.subjects]) for entry in entries]
    return [float(value) for value in np.mean(rows, axis=0)]


def line_of(entries: Sequence[Entry], setting: Setting, network: Network, recipe: Recipe) -> Line:
    """The line of a network: of the seeds that were trained long enough, otherwise of those that have a length."""
    key = (setting.name, network.name, recipe.name)
    seeds = sorted({entry.seed for entry in entries if entry.key[:3] == key})
    by_seed = {
        seed: convergence_of(of_job(entries, Job(setting, network, recipe, seed)), recipe.lengths) for seed in seeds
    }
    begun = {seed: found for seed, found in by_seed.items() if found.counts}
    return Line(network, {seed: found for seed, found in begun.items() if found.end != "not yet"} or begun)


def spread_text(values: Iterable[float], form: str = "{:.2f}", unit: str = "") -> str:
    """``17.20 ± 0.10 mm``: the mean and half the range of the values; – without values."""
    found = list(values)
    if not found:
        return "–"
    mean = form.format(sum(found) / len(found))
    return (
        f"{mean}{unit}"
        if len(found) == 1
        else f"{mean} ± {form.replace('+', '').format((max(found) - min(found)) / 2)}{unit}"
    )
