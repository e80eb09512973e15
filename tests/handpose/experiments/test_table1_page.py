"""handpose/experiments/table1_page.py; more of it in the tests of tools/table1.py"""

from __future__ import annotations

import json
from pathlib import Path

from handpose.experiments import table1_page
from handpose.experiments.networks import NETWORKS
from handpose.experiments.results import Result

RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def test_data_of_the_paper_are_comparable() -> None:
    """Then the page says so."""
    page = table1_page.page_of([], {}, "NYU", 8252, iterations=9, seed=1)
    assert "on data/nyu (NYU)" in page and "The data are the paper's, so joint errors" in page


def test_the_page_that_is_there_has_the_figures_that_are_there() -> None:
    """docs/results/table1.md is what this module makes of docs/results/table1.json."""
    found = json.loads((RESULTS / "table1.json").read_text(encoding="utf-8"))
    results = {name: Result(**figures) for name, figures in found["networks"].items()}
    page = table1_page.page_of(NETWORKS, results, found["data"], found["frames"], found["iterations"], found["seed"])
    assert (RESULTS / "table1.md").read_text(encoding="utf-8") == page
