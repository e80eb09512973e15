"""handpose/experiments/results.py; more of it in the tests of tools/table1.py"""

from __future__ import annotations

from handpose.experiments.results import Result, findings


def test_the_papers_findings_are_confirmed_or_not() -> None:
    """By the figures, whatever they are."""

    def of(error: float, angle: float, broken: float | None = None) -> Result:
        return Result(error, error, angle, broken, 0.5)

    paper = {"direct_joint": of(17.2, 21.4), "direct_parameter": of(26.7, 12.2, 0.0),
             "no_limit": of(16.9, 12.0, 0.186), "ours": of(16.9, 12.2, 0.009)}  # fmt: skip
    lines = findings(paper)
    assert len(lines) == 5 and all(": confirmed, " in line for line in lines)
    assert "16.90 and 17.20 mm" in lines[0] and "0.9% and 18.6% of the frames" in lines[3]
    other = findings({**paper, "ours": of(18.9, 25.0, 0.15)})
    assert [": confirmed" in line for line in other] == [False, True, False, False, False]
    assert findings({"ours": paper["ours"]}) == []
