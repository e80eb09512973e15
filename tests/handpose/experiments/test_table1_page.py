"""handpose/experiments/table1_page.py; more of it in the tests of tools/table1.py"""

from __future__ import annotations

from handpose.experiments import table1_page


def test_data_of_the_paper_are_comparable() -> None:
    """Then the page says so."""
    page = table1_page.page_of([], {}, "NYU", 8252, iterations=9, seed=1)
    assert "on data/nyu (NYU)" in page and "The data are the paper's, so joint errors" in page
