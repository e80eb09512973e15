"""experiments/table1/plan.py"""

from __future__ import annotations

from experiments.table1.networks import DIRECT_JOINT, NO_LIMIT, OURS
from experiments.table1.plan import Job, convergence_of, lambdas, next_length, order, report
from experiments.table1.recipes import ADAM, PAPER
from experiments.table1.settings import MANY_HANDS, ONE_HAND
from tests.support.made_store import entry

JOB = Job(ONE_HAND, OURS, PAPER, 1)
LENGTHS = PAPER.lengths


def series(*errors: float) -> list:  # type: ignore[type-arg]
    """Entries of "ours" at the first lengths, with these errors."""
    return [entry("ours", error, length) for error, length in zip(errors, LENGTHS)]


def test_a_training_is_done_when_half_of_it_changes_little() -> None:
    """A change below 2%, up or down, ends it; the last entry counts. (The error of both subjects is 1 mm more.)"""
    for last in (18.65, 19.35):
        found = convergence_of(series(24, 19, last), LENGTHS)
        assert (found.end, found.counts, len(found.entries)) == ("done", found.entries[2], 3)
    assert convergence_of(series(24, 19, 18.5), LENGTHS).end == "not yet"


def test_a_training_that_gets_worse_ends() -> None:
    """A training whose error rises ends, and its best length counts."""
    found = convergence_of(series(24, 19, 20), LENGTHS)
    assert found.end == "rises" and found.counts is found.entries[1]


def test_a_training_whose_error_falls_where_the_lengths_end() -> None:
    """It ends as "falls"; ``before`` is the entry of the previous length."""
    found = convergence_of(series(50, 40, 30, 24), LENGTHS)
    assert (found.end, found.counts, found.before) == ("falls", found.entries[3], found.entries[2])
    done = convergence_of(series(24, 19, 18.65), LENGTHS)
    assert done.before is done.entries[-2]
    rises = convergence_of(series(24, 19, 20), LENGTHS)
    assert rises.before is rises.counts and convergence_of(series(24), LENGTHS).before is not None


def test_what_is_beyond_a_gap_or_the_end_does_not_count() -> None:
    """Entries after a gap or after the end are ignored, and the order of entries does not matter."""
    assert convergence_of([*series(24)[::-1], entry("ours", 10, LENGTHS[2])], LENGTHS).end == "not yet"
    assert len(convergence_of(series(24, 23.9, 10)[::-1], LENGTHS).entries) == 2
    assert convergence_of([], LENGTHS) == ([], None, "not yet")


def test_the_next_length() -> None:
    """Lengths follow one another until the end or the longest one; a single length is run only once."""
    assert [next_length(series(*e), JOB) for e in ((), (24,), (24, 19), (24, 23.9))] == [4000, 6000, 9000, None]
    assert next_length(series(24, 19), JOB, longest=8999) is None
    assert next_length(series(50, 40, 30, 24), JOB) is None
    only = Job(ONE_HAND, OURS, PAPER, 1, only=9000)
    assert next_length(series(24, 19), only) == 9000 and next_length(series(24, 19, 10), only) is None


def test_the_order() -> None:
    """The order is seed by seed in the paper's setting, then many hands by our recipe; other settings must be named."""
    jobs = list(order(ONE_HAND))
    blocks = list(dict.fromkeys((job.setting.name, job.recipe.name, job.seed) for job in jobs))
    one = [("one_hand", recipe, seed) for seed in (1, 2) for recipe in ("adam", "paper")]
    assert blocks == [*one, *(("many_hands", "adam", seed) for seed in (1, 2))]
    assert [job.network.name for job in jobs[22:26]] == ["direct_joint", "ours", "ours_scale", "ours_bones"]
    exact = [job for job in jobs if job.network.labels == "exact"]
    assert {job.recipe.name for job in exact} == {"adam"} and len(jobs) == 2 * (6 + 5) + 2 * 4
    assert len(list(order(MANY_HANDS, None, [NO_LIMIT], [ADAM], [3]))) == 1
    assert len(list(order(MANY_HANDS, recipes=[ADAM]))) == 2 * 4


def test_lambdas_are_as_long_as_ours() -> None:
    """Lambdas use the length at which "ours" has converged, and shared networks are not trained twice."""
    assert lambdas(series(24, 23.9), ONE_HAND) == []  # by our recipe, unless another is asked for
    assert lambdas(series(24, 19), ONE_HAND, recipe=PAPER) == []
    jobs = lambdas(series(24, 23.9), ONE_HAND, recipe=PAPER)
    assert {job.only for job in jobs} == {6000} and len(jobs) == 8
    assert [job.network.name for job in jobs if next_length(series(24, 23.9), job) is None] == ["ours"]
    assert {job.only for job in lambdas([], ONE_HAND, 50)} == {50}


def test_what_is_left() -> None:
    """The remaining hours follow from the store's rates, in which an entry takes an hour."""
    rows = report([JOB, Job(ONE_HAND, DIRECT_JOINT, PAPER, 1)], lambda setting: series(24, 23.9))
    assert [row[1:4] for row in rows[1:3]] == [["4000, 6000", "25.00, 24.90", "done"], ["–", "–", "missing"]]
    rate = 2 / 10000  # hours per iteration
    assert rows[2][4] == rows[3][4] == f"{rate * (5400 + 400 + 600):.1f}"
    assert report([JOB], lambda setting: [])[-1][-1] == "not known"
