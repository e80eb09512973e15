"""What the paper concludes from its Table 1 (Sec. 4.1), and whether trainings here say so too.

Each finding is a difference whose sign says yes or no. It is decided when two seeds at least were trained long enough,
all have one sign, and the mean difference is larger than the spread between them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from handpose.experiments.plan import MATTERS
from handpose.experiments.summary import Line

Values = Mapping[str, Callable[[str], float]]  # of each network: a figure by its name


class Finding(NamedTuple):
    """One conclusion.

    text      of the page
    networks  whose figures it compares
    value     the difference, positive if it speaks for the conclusion
    form      of the difference
    paper     the difference in the paper's table
    """

    text: str
    networks: tuple[str, ...]
    value: Callable[[Values], float]
    form: str
    paper: float


class Decision(NamedTuple):
    """What the seeds say of a finding: ``word`` is confirmed, refuted or undecided, ``why`` says why not decided."""

    word: str
    values: Sequence[float]
    why: str = ""


def _difference(figure: str, more: str, less: str) -> Callable[[Values], float]:
    return lambda of: of[more](figure) - of[less](figure)


def _worst(figure: str, worst: str, others: Sequence[str]) -> Callable[[Values], float]:
    return lambda of: of[worst](figure) - max(of[other](figure) for other in others)


def _no_dearer(figure: str, one: str, than: str) -> Callable[[Values], float]:
    """How much of what may pass for equal is left."""
    return lambda of: (1 + MATTERS) * of[than](figure) - of[one](figure)


MM, DEGREES, POINTS = "{:+.2f} mm", "{:+.2f}°", "{:+.1%}"
ANGLE, EXACT = "fitted_angle_deg", "angle_deg"
FINDINGS = (
    Finding("ours is better on joints than direct joint", ("ours", "direct_joint"),
            _difference("error_14_mm", "direct_joint", "ours"), MM, 17.2 - 16.9),
    Finding("direct joint is better on joints than direct parameter", ("direct_joint", "direct_parameter"),
            _difference("error_14_mm", "direct_parameter", "direct_joint"), MM, 26.7 - 17.2),
    Finding("ours is better on joints than direct parameter", ("ours", "direct_parameter"),
            _difference("error_14_mm", "direct_parameter", "ours"), MM, 26.7 - 16.9),
    Finding("direct joint is the worst of the four on angles", ("direct_joint", "direct_parameter", "no_limit", "ours"),
            _worst(ANGLE, "direct_joint", ("direct_parameter", "no_limit", "ours")), DEGREES, 21.4 - 12.2),
    Finding("... also by the exact angles, with direct parameter trained on them",
            ("direct_joint", "direct_parameter_exact", "no_limit", "ours"),
            _worst(EXACT, "direct_joint", ("direct_parameter_exact", "no_limit", "ours")), DEGREES, float("nan")),
    Finding("ours is as good on angles as direct parameter, to 2%", ("ours", "direct_parameter"),
            _no_dearer(ANGLE, "ours", "direct_parameter"), DEGREES, 1.02 * 12.2 - 12.2),
    Finding("PhysLimit keeps angles within their limits", ("ours", "no_limit"),
            _difference("out_of_limits", "no_limit", "ours"), POINTS, 0.186 - 0.009),
    Finding("... and costs less than 2% of the joint error", ("ours", "no_limit"),
            _no_dearer("error_14_mm", "ours", "no_limit"), MM, 1.02 * 16.9 - 16.9),
)  # fmt: skip


def decide(finding: Finding, lines: Mapping[str, Line]) -> Decision:
    """What the seeds that all its networks have say of a finding; ``lines`` are by network."""
    chosen = {name: lines[name] for name in finding.networks if name in lines}
    missing = [name for name in finding.networks if name not in chosen]
    seeds = set.intersection(*(set(line.verdicts) for line in chosen.values())) if chosen and not missing else set()
    if not seeds:
        return Decision("undecided", (), "not trained yet")
    values = [finding.value({name: _figures_of(line, seed) for name, line in chosen.items()}) for seed in sorted(seeds)]
    if any(line.verdicts[seed].end == "not yet" for line in chosen.values() for seed in seeds):
        return Decision("undecided", values, "not trained long enough yet")
    if len(values) < 2:
        return Decision("undecided", values, "one seed")
    if not (min(values) > 0 or max(values) < 0):
        return Decision("undecided", values, "the seeds do not agree")
    mean, spread = sum(values) / len(values), max(values) - min(values)
    if not abs(mean) > spread:  # NaN decides nothing
        return Decision("undecided", values, "not more than the spread of the seeds")
    return Decision("confirmed" if mean > 0 else "refuted", values)


def _figures_of(line: Line, seed: int) -> Callable[[str], float]:
    return lambda figure: line.values(figure).get(seed, float("nan"))
