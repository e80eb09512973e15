"""experiments/table1/findings.py and experiments/table1/summary.py"""

from __future__ import annotations

import math

import pytest

from experiments.table1.findings import FINDINGS, decide
from experiments.table1.networks import NETWORKS
from experiments.table1.recipes import PAPER
from experiments.table1.settings import ONE_HAND
from experiments.table1.summary import Line, curve_of, line_of, spread_text, value_of
from tests.support.made_store import PAPERS, entry, trained

OURS_OR_JOINT = FINDINGS[0]


def lines(entries) -> dict[str, Line]:  # type: ignore[no-untyped-def]
    """Lines of the table, by network."""
    return {network.name: line_of(entries, ONE_HAND, network, PAPER) for network in NETWORKS}


def test_the_papers_figures_confirm_its_findings() -> None:
    """The paper's figures confirm all findings, with the differences of its table."""
    found = lines(list(trained()))
    for finding in FINDINGS:
        decision = decide(finding, found)
        assert decision.word == "confirmed" and len(decision.differences) == 2, finding.text
        if math.isfinite(finding.paper):
            assert decision.differences == pytest.approx([finding.paper] * 2, abs=0.03), finding.text


def test_other_figures_refute_them() -> None:
    """Other figures refute the findings by the corresponding differences."""
    other = {**PAPERS, "ours": (19.2, 25.0, 0.3)}
    found = [decide(finding, lines(list(trained(figures_of=other)))) for finding in FINDINGS]
    assert [d.word for d in found] == ["refuted", "confirmed", "confirmed", *["refuted"] * 5]
    assert found[0].differences == pytest.approx([-2, -2])


def test_what_is_not_decided() -> None:
    """One seed, seeds that disagree, a spread as large as the difference, and short or missing runs decide nothing."""

    def of(*pairs: tuple[float, float], ends: bool = True) -> str:
        entries = []
        for seed, errors in enumerate(pairs, 1):
            for name, error in zip(OURS_OR_JOINT.networks, errors):
                entries += [entry(name, error, length, seed) for length in PAPER.lengths[: 2 if ends else 1]]
        return decide(OURS_OR_JOINT, lines(entries)).why

    assert of((10, 11), (10, 11.5)) == ""
    assert of((10, 11)) == "one seed"
    assert of((10, 11), (11, 10)) == "the seeds do not agree"
    assert of((10, 10.5), (10, 13)) == "not more than the spread of the seeds"
    assert of((10, 11), (10, 11), ends=False) == "not trained long enough yet"
    assert of() == "not trained yet"


@pytest.mark.parametrize(
    ("before", "last", "why"),
    [
        (1.0, 1.0, ""),
        (1.0, 2.0, ""),
        (1.0, 0.85, ""),
        (1.0, 0.8, "the difference still changes"),
        (-0.1, 0.1, ""),
        (-1.0, -0.8, "the difference still changes"),
        (math.nan, 1.0, "the difference still changes"),
    ],
    ids=["steady", "grows", "shrinks slowly", "shrinks", "has turned", "against the paper, shrinks", "not known"],
)
def test_where_errors_still_fall(before: float, last: float, why: str) -> None:
    """A difference is decided if five more halves at this pace would not change its sign."""
    entries = []
    for seed in (1, 2):
        for length, ours, more in zip(PAPER.lengths, (40, 30, 20, 15), (5, 5, before, last)):
            entries += [entry("ours", ours, length, seed), entry("direct_joint", ours + more, length, seed)]
    found = lines(entries)
    assert found["ours"].ends == ["falls"] and decide(OURS_OR_JOINT, found).why == why


def test_the_pace_is_that_of_all_seeds() -> None:
    """Opposite changes of two seeds cancel, so that the mean difference is decided."""
    entries = []
    for seed, before in ((1, 1.5), (2, 0.5)):
        for length, ours, more in zip(PAPER.lengths, (40, 30, 20, 15), (5, 5, before, 1 + seed / 100)):
            entries += [entry("ours", ours, length, seed), entry("direct_joint", ours + more, length, seed)]
    assert decide(OURS_OR_JOINT, lines(entries)).why == ""
    assert decide(OURS_OR_JOINT, lines([e for e in entries if e.seed == 1])).why == "one seed"


def test_what_is_done_still_changes_beside_what_falls() -> None:
    """A finished network's last change counts too: direct joint falls by 0.5 per half, ours by 0.35."""
    entries = []
    for seed in (1, 2):
        for length, ours, joint in zip(PAPER.lengths, (40, 30, 20.35, 20), (50, 40, 21.5, 21)):
            entries += [entry("ours", ours, length, seed), entry("direct_joint", joint, length, seed)]
    found = lines(entries)
    assert (found["ours"].ends, found["direct_joint"].ends) == (["done"], ["falls"])
    assert decide(OURS_OR_JOINT, found).why == ""


def test_a_seed_that_is_on_its_way_changes_nothing() -> None:
    """An unfinished third seed changes neither the decision nor the means."""
    entries = list(trained())
    before = lines(entries)
    on_its_way = [entry("ours", 40, PAPER.lengths[0], seed=3), entry("direct_joint", 20, PAPER.lengths[0], seed=3)]
    after = lines([*entries, *on_its_way])
    assert decide(OURS_OR_JOINT, after) == decide(OURS_OR_JOINT, before)
    assert after["ours"].values("error_14_mm") == before["ours"].values("error_14_mm")
    assert lines(on_its_way)["ours"].ends == ["not yet"]


def test_means_over_subjects_and_seeds() -> None:
    """Frames have equal weight, and a spread is half of the range."""
    assert (
        value_of(entry(error=20), "error_14_mm") == 21
        and value_of(entry(error=20), "error_14_mm", "smaller hand") == 22
    )
    assert math.isnan(value_of(entry(), "error_14_mm", "nobody"))
    assert curve_of([entry(error=20), entry(error=22)], "joints_mm") == pytest.approx([22] * 31)
    assert spread_text([1, 2]) == "1.50 ± 0.50" and spread_text([], "{:.1%}") == "–"
    assert spread_text([-1, -2], "{:+.1f}", " mm") == "-1.5 ± 0.5 mm" and spread_text([3.0], unit="°") == "3.00°"
