"""benchmarks/fit.py: every plan is timed."""

from __future__ import annotations

import pytest

from benchmarks import fit
from handpose.fit.search import PLANS
from tests.support.running import run_tool


def test_a_benchmark(monkeypatch: pytest.MonkeyPatch, keep_threads: None) -> None:
    """Each plan has a row, with a time for each column."""
    monkeypatch.setattr(fit, "MAX_CROPS", 2)
    head, *rows = run_tool("benchmarks.fit", "--repeats", "1").out.splitlines()
    assert head.endswith("all, 2 together")
    assert [row.split()[0] for row in rows] == list(PLANS)
    assert all(float(cell) > 0 for row in rows for cell in row.split()[1:])
