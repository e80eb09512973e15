"""The conclusions of the paper from its Table 1 (Sec. 4.1), and whether the training runs here confirm them.

Each finding is a difference whose sign decides; where two networks are to be equally good, a small deficit passes. It
is decided when at least two seeds were trained long enough, all have the same sign, and the mean is larger than the
spread between them. Where an error still falls at the longest length, the mean must keep its sign for some more
increments of all training runs involved, each of which changes it as much as the last did. The mean of all seeds is
used, because the change of a single one is mostly chance, and five times that would decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from experiments.table1.networks import NETWORKS
from experiments.table1.plan import MATTERS
from experiments.table1.summary import Line

HALVES = 5  # number of increments of a training run: together nearly eight times as long

Values = Mapping[str, Callable[[str], float]]  # by network: a figure by its name
Figure = Callable[[Values], float]


def _none(of: Values) -> float:
    return 0.0


class Finding(NamedTuple):
    """One conclusion.

    text        of the page
    networks    compared networks
    difference  positive if it supports the conclusion
    form        of the difference
    allowed     how far below 0 the difference may be and still pass
    """

    text: str
    networks: tuple[str, ...]
    difference: Figure
    form: str
    allowed: Figure = _none

    def margin(self, of: Values) -> float:
        """The difference plus the allowance: positive if the conclusion is true."""
        return self.difference(of) + self.allowed(of)

    @property
    def paper(self) -> float:
        """The difference in the paper's table; NaN if that has no such figures."""
        published = {network.name: network.paper for network in NETWORKS}
        return self.difference({name: _published(published[name]) for name in self.networks})


class Decision(NamedTuple):
    """The result of a finding over the seeds.

    word         confirmed, refuted or undecided
    differences  of each seed
    why          reason if it is not decided
    allowed      of all seeds, on the mean
    """

    word: str
    differences: Sequence[float]
    why: str = ""
    allowed: float = 0.0


def _less(figure: str, one: str, than: str) -> Figure:
    """The difference of a figure between two networks."""
    return lambda of: of[than](figure) - of[one](figure)


def _worst(figure: str, worst: str, others: Sequence[str]) -> Figure:
    return lambda of: of[worst](figure) - max(of[other](figure) for other in others)


def _little(figure: str, name: str) -> Figure:
    """The possible change of a network's figure by another half of a training run."""
    return lambda of: MATTERS * of[name](figure)


MM, DEGREES, POINTS = "{:+.2f} mm", "{:+.2f}°", "{:+.1%}"
JOINTS, ANGLE, EXACT, OUT = "error_14_mm", "fitted_angle_deg", "angle_deg", "out_of_limits"
FINDINGS = (
    Finding("ours is better on joints than direct joint", ("ours", "direct_joint"),
            _less(JOINTS, "ours", "direct_joint"), MM),
    Finding("direct joint is better on joints than direct parameter", ("direct_joint", "direct_parameter"),
            _less(JOINTS, "direct_joint", "direct_parameter"), MM),
    Finding("ours is better on joints than direct parameter", ("ours", "direct_parameter"),
            _less(JOINTS, "ours", "direct_parameter"), MM),
    Finding("direct joint is the worst of the four on angles", ("direct_joint", "direct_parameter", "no_limit", "ours"),
            _worst(ANGLE, "direct_joint", ("direct_parameter", "no_limit", "ours")), DEGREES),
    Finding("... also by the exact angles, with direct parameter trained on them",
            ("direct_joint", "direct_parameter_exact", "no_limit", "ours"),
            _worst(EXACT, "direct_joint", ("direct_parameter_exact", "no_limit", "ours")), DEGREES),
    Finding("ours is as good on angles as direct parameter", ("ours", "direct_parameter"),
            _less(ANGLE, "ours", "direct_parameter"), DEGREES, _little(ANGLE, "direct_parameter")),
    Finding("PhysLimit keeps angles within their limits", ("ours", "no_limit"), _less(OUT, "ours", "no_limit"), POINTS),
    Finding("... without increasing the joint error", ("ours", "no_limit"),
            _less(JOINTS, "ours", "no_limit"), MM, _little(JOINTS, "no_limit")),
)


def decide(finding: Finding, lines: Mapping[str, Line]) -> Decision:
    """Decide a finding from the seeds that all its networks have; ``lines`` are by network."""
    chosen = {name: lines[name] for name in finding.networks if name in lines and lines[name].by_seed}
    if len(chosen) < len(finding.networks):
        return Decision("undecided", (), "not trained yet")
    seeds = set.intersection(*(set(line.by_seed) for line in chosen.values()))
    if not seeds or any(line.by_seed[seed].end == "not yet" for line in chosen.values() for seed in seeds):
        return Decision("undecided", (), "not trained long enough yet")
    of_seeds = [{name: _figures_of(line, seed) for name, line in chosen.items()} for seed in sorted(seeds)]
    differences = [finding.difference(of) for of in of_seeds]
    margins = [finding.margin(of) for of in of_seeds]
    falls = any(line.by_seed[seed].end == "falls" for line in chosen.values() for seed in seeds)
    earlier = [finding.margin({name: _figures_of(line, seed, before=falls) for name, line in chosen.items()})
               for seed in sorted(seeds)]
    mean, spread = sum(margins) / len(margins), max(margins) - min(margins)
    why = ""
    if len(margins) < 2:
        why = "one seed"
    elif not (min(margins) > 0 or max(margins) < 0):
        why = "the seeds do not agree"
    elif not abs(mean) > spread:  # NaN decides nothing
        why = "not more than the spread of the seeds"
    elif not mean * (mean + HALVES * (mean - sum(earlier) / len(earlier))) >= 0:
        why = "the difference still changes"
    word = "undecided" if why else "confirmed" if mean > 0 else "refuted"
    return Decision(word, differences, why, sum(map(finding.allowed, of_seeds)) / len(of_seeds))


def _figures_of(line: Line, seed: int, *, before: bool = False) -> Callable[[str], float]:
    return lambda figure: line.values(figure, before=before).get(seed, float("nan"))


def _published(figures: object) -> Callable[[str], float]:
    return lambda figure: float(getattr(figures, figure, math.nan))
