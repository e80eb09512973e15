"""What is trained next for Table 1, and when a training is long enough.

A training is done as soon as another half of it changes its error by less than 2%, or raises it: then the one before was
long enough, and longer ones learn the training frames by heart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from handpose.experiments.ledger import Entry
from handpose.experiments.networks import LAMBDAS, NETWORKS, OURS, Network
from handpose.experiments.recipes import ADAM, PAPER, Recipe
from handpose.experiments.settings import MANY_HANDS, Setting

MATTERS = 0.02  # of the error

End = Literal["done", "rises", "not yet"]


class Verdict(NamedTuple):
    """How far a training has come.

    entries  of its lengths, rising, up to the one that ended it
    counts   the entry whose figures count; None if there is none yet
    end      "done": another half changed less than 2%; "rises": it raised the error; "not yet"
    """

    entries: list[Entry]
    counts: Entry | None
    end: End


@dataclass(frozen=True)
class Job:
    """A training that is wanted, until it is done, or of one length."""

    setting: Setting
    network: Network
    recipe: Recipe
    seed: int
    only: int | None = None

    def __str__(self) -> str:
        length = f", {self.only} iterations" if self.only else ""
        return f"{self.setting.name}: {self.network.name}, {self.recipe.name}, seed {self.seed}{length}"


def verdict(entries: Iterable[Entry], lengths: Sequence[int]) -> Verdict:
    """The verdict on the entries of one training; those of other lengths, and beyond a gap, do not count."""
    by_length = {entry.iterations: entry for entry in entries}
    found: list[Entry] = []
    for length in lengths:
        if length not in by_length:
            break
        found.append(by_length[length])
        if len(found) > 1:
            before, now = found[-2].error_mm, found[-1].error_mm
            if abs(now - before) < MATTERS * before:
                return Verdict(found, found[-1], "done")
            if now > before:
                return Verdict(found, found[-2], "rises")
    return Verdict(found, found[-1] if found else None, "not yet")


def of_job(ledger: Iterable[Entry], job: Job) -> list[Entry]:
    """The entries of one training."""
    key = (job.setting.name, job.network.name, job.recipe.name, job.seed)
    return [entry for entry in ledger if entry.key[:4] == key]


def next_length(ledger: Iterable[Entry], job: Job, longest: int | None = None) -> int | None:
    """The length that is to be trained next; None if there is none."""
    entries = of_job(ledger, job)
    if job.only:
        return None if any(entry.iterations == job.only for entry in entries) else job.only
    found = verdict(entries, job.recipe.lengths)
    if found.end != "not yet" or len(found.entries) == len(job.recipe.lengths):
        return None
    length = job.recipe.lengths[len(found.entries)]
    return None if longest and length > longest else length


def order(
    setting: Setting,
    many: Setting | None = MANY_HANDS,
    networks: Sequence[Network] = NETWORKS,
    recipes: Sequence[Recipe] = (PAPER, ADAM),
    seeds: Sequence[int] = (1, 2),
) -> Iterator[Job]:
    """All trainings in the order in which they answer most: the paper's setting first, then hands of many people."""

    def of(where: Setting, recipe: Recipe, seed: int) -> Iterator[Job]:
        return (Job(where, network, recipe, seed) for network in networks if network.is_for(where))

    for seed in seeds:
        for recipe in recipes:
            yield from of(setting, recipe, seed)
    for seed in seeds if many is not None else ():
        for recipe in reversed(recipes):
            assert many is not None
            yield from of(many, recipe, seed)


def lambdas(ledger: Sequence[Entry], setting: Setting, length: int | None = None) -> list[Job]:
    """The trainings of ours by weights of PhysLimit, all as long as ours was trained; none before that is known."""
    ours = verdict(of_job(ledger, Job(setting, OURS, PAPER, 1)), PAPER.lengths)
    if length is None and ours.end != "not yet" and ours.counts is not None:
        length = ours.counts.iterations
    return [Job(setting, network, PAPER, 1, length) for network in LAMBDAS] if length else []
