"""docs/paper.md: its figures are those of their sources, and every claim links to a test."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.test_documents import anchor_of

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAPER = (DOCS / "paper.md").read_text(encoding="utf-8")
LINK = re.compile(r'\[([^\[\]]*)\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?(?:\s+"([^"]*)")?\)')
FIGURES = sorted(
    {
        (text, file, anchor)
        for text, file, anchor, _ in LINK.findall(PAPER)
        if re.match(r"\d.*md$", text + file)
    }
)


def sections(text: str) -> dict[str, str]:
    """Return the text below each heading, up to the next, by the heading's anchor."""
    parts = re.split(r"^#+ (.*)\n", text, flags=re.MULTILINE)
    return dict(zip(map(anchor_of, parts[1::2]), parts[2::2]))


@pytest.mark.parametrize(("figure", "file", "anchor"), FIGURES)
def test_a_figure_stands_where_its_link_leads(figure: str, file: str, anchor: str) -> None:
    """Each linked figure occurs, with all its digits, in the section that its link leads to."""
    text = sections((DOCS / file).read_text(encoding="utf-8"))[anchor]
    amount = figure.removesuffix(" mm")  # a table may have the unit in its heading
    assert re.search(rf"(?<![\d.]){re.escape(amount)}(?![\d.]*\d)", text), figure


def test_every_claim_is_pinned_by_a_test() -> None:
    """Each item "Tests:" links to at least one test function, and to nothing else."""
    items = [item for item in re.split(r"\n(?=- |\n)", PAPER) if item.startswith("- Tests:")]
    assert len(items) >= 15
    assert len(FIGURES) >= 15
    for item in items:
        titles = [title for _, _, _, title in LINK.findall(item)]
        assert titles and all(title.startswith("test_") for title in titles), item
