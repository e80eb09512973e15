"""The next training for Table 1, and the criterion for the end of a training run.

A training is done as soon as another half of it changes its error by less than 2%, or increases it: then the previous
length was sufficient, and longer ones overfit. It also ends at the longest length of its recipe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from experiments.table1.networks import LAMBDAS, NETWORKS, OURS, Network
from experiments.table1.recipes import ADAM, RECIPES, Recipe
from experiments.table1.settings import MANY_HANDS, Setting
from experiments.table1.store import Entry

MATTERS = 0.02  # relative change of the error
ASKED_OF_MANY = ("direct_joint", "ours", "ours_scale", "ours_bones")

End = Literal["done", "rises", "falls", "not yet"]


class Convergence(NamedTuple):
    """The convergence of a training run.

    entries  of its lengths, ascending, up to the one that ended it
    counts   the entry whose scores count; None if there is none yet
    end      "done": another half changed less than 2%; "rises": the error increased; "falls": the error still decreased
             at the longest length; "not yet"
    """

    entries: list[Entry]
    counts: Entry | None
    end: End

    @property
    def before(self) -> Entry | None:
        """The scores at the previous length; those that count if there is none, or if the error rose since."""
        return self.entries[-2] if self.counts is self.entries[-1] and len(self.entries) > 1 else self.counts


@dataclass(frozen=True)
class Job:
    """A training to be run, until it is done, or for one length."""

    setting: Setting
    network: Network
    recipe: Recipe
    seed: int
    only: int | None = None

    def __str__(self) -> str:
        length = f", {self.only} iterations" if self.only else ""
        return f"{self.setting.name}: {self.network.name}, {self.recipe.name}, seed {self.seed}{length}"


def convergence_of(entries: Iterable[Entry], lengths: Sequence[int]) -> Convergence:
    """The convergence of one training by its entries; those of other lengths, and beyond a gap, do not count."""
    by_length = {entry.iterations: entry for entry in entries}
    found: list[Entry] = []
    for length in lengths:
        if length not in by_length:
            break
        found.append(by_length[length])
        if len(found) > 1:
            before, now = found[-2].error_mm, found[-1].error_mm
            if abs(now - before) < MATTERS * before:
                return Convergence(found, found[-1], "done")
            if now > before:
                return Convergence(found, found[-2], "rises")
    return Convergence(found, found[-1] if found else None, "falls" if len(found) == len(lengths) else "not yet")


def of_job(store: Iterable[Entry], job: Job) -> list[Entry]:
    """The entries of one training."""
    key = (job.setting.name, job.network.name, job.recipe.name, job.seed)
    return [entry for entry in store if entry.key[:4] == key]


def next_length(store: Iterable[Entry], job: Job, longest: int | None = None) -> int | None:
    """The next length to be trained; None if there is none."""
    entries = of_job(store, job)
    if job.only:
        return None if any(entry.iterations == job.only for entry in entries) else job.only
    found = convergence_of(entries, job.recipe.lengths)
    if found.end != "not yet":
        return None
    length = job.recipe.lengths[len(found.entries)]
    return None if longest and length > longest else length


def is_asked(network: Network, setting: Setting, recipe: Recipe) -> bool:
    """True if a question of the page depends on this training.

    Hands of many people show the cost of the model and its remedies. Direct parameter on exact angles is not in the
    paper: our recipe, which takes less time, answers both.
    """
    if setting.has_many_people:
        return network.name in ASKED_OF_MANY
    return recipe is ADAM or network.labels != "exact"


def order(
    setting: Setting,
    many: Setting | None = MANY_HANDS,
    networks: Sequence[Network] | None = None,
    recipes: Sequence[Recipe] = tuple(RECIPES.values()),
    seeds: Sequence[int] = (1, 2),
) -> Iterator[Job]:
    """All training runs, the most informative first.

    By default those that a question depends on. The paper's setting comes first, then hands of many people, these with
    our recipe alone.
    """

    def of(where: Setting, recipe: Recipe, seed: int) -> Iterator[Job]:
        chosen = networks or [network for network in NETWORKS if is_asked(network, where, recipe)]
        return (Job(where, network, recipe, seed) for network in chosen if network.is_for(where))

    for seed in seeds:
        for recipe in recipes:
            yield from of(setting, recipe, seed)
    if many not in (None, setting) and ADAM in recipes:
        for seed in seeds:
            yield from of(many, ADAM, seed)


def lambdas(store: Sequence[Entry], setting: Setting, length: int | None = None, recipe: Recipe = ADAM) -> list[Job]:
    """The training runs of ours by weights of PhysLimit, all as long as ours was trained; none before that is known."""
    ours = convergence_of(of_job(store, Job(setting, OURS, recipe, 1)), recipe.lengths)
    if length is None and ours.end != "not yet" and ours.counts is not None:
        length = ours.counts.iterations
    return [Job(setting, network, recipe, 1, length) for network in LAMBDAS] if length else []


def report(
    jobs: Sequence[Job], store_of: Callable[[Setting], Sequence[Entry]], longest: int | None = None
) -> list[list[str]]:
    """A row for each training: its state, and an estimate of the remaining hours from the rates in the store."""
    settings = {job.setting.name: job.setting for job in jobs}.values()
    every = [entry for setting in settings for entry in store_of(setting)]
    rows, total = [["training", "lengths", "error, mm", "state", "hours left"]], 0.0
    for job in jobs:
        entries = of_job(store_of(job.setting), job)
        found = convergence_of(entries, job.recipe.lengths)
        done = [entry for entry in entries if entry.iterations == job.only] if job.only else found.entries
        left = _hours(every, job, len(done)) if next_length(store_of(job.setting), job, longest) else 0.0
        state = ("done" if done else "missing") if job.only else found.end if done else "missing"
        total += left
        lengths = ", ".join(f"{entry.iterations}" for entry in done) or "–"
        errors = ", ".join(f"{entry.error_mm:.2f}" for entry in done) or "–"
        rows.append([str(job), lengths, errors, state, f"{left:.1f}" if left else "–"])
    return [*rows, ["in total", "", "", "", f"{total:.1f}" if every else "not known"]]


def _hours(store: Sequence[Entry], job: Job, done: int) -> float:
    """About how long the rest of a training run takes, if it ends where its recipe's training runs did on the mean."""
    alike = [entry for entry in store if entry.recipe == job.recipe.name]
    if not alike:
        return 0.0
    rate = sum(entry.seconds for entry in alike) / sum(entry.iterations for entry in alike)
    usual = max(done + 1, round(len(alike) / len({entry.key[:4] for entry in alike})), 2)
    lengths = (job.only,) if job.only else job.recipe.lengths[done:usual]
    ends = sum(length - job.recipe.branch(length) for length in lengths)
    begun = 0 if job.only or not done else job.recipe.branch(job.recipe.lengths[done - 1])
    return rate * (job.recipe.branch(lengths[-1]) - begun + ends) / 3600 if lengths else 0.0
